"""From a model to a schedule: the problem in integers, the searches for it, and what they leave behind."""
