"""Answers other than a schedule: `explanation` gives them; each other module is one way to find or to prove them."""
