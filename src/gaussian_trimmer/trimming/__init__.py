"""The trim: `trim.py` reads as the algorithm, `decision.py` as what is decided for each object."""
