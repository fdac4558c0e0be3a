"""Design variants: size of the platform and growth of WCETs, answered by schedules."""
