"""Where to look from, and what is seen there."""
