"""Measuring trims: metrics, data sets."""
