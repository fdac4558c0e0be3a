"""From what is stated to tasks: what activates what, when, where and in which order."""
