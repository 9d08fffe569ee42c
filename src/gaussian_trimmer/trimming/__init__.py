"""The trim: `trim.py` follows the algorithm step by step, `decision.py` what is decided for each object."""
