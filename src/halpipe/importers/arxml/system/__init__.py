"""What the elements say about timing, as frozen values."""
