"""What if the design were another one: its size, the growth of its WCETs. Questions that schedules answer."""
