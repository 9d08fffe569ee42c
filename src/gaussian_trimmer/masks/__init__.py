"""Masks of an object in pictures: read from files, or drawn in the views that a trim would look from."""
