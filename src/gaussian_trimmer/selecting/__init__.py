"""Rough selections from clicks, boxes and masks of pictures."""
