"""Evaluation of trims against ground truth: metrics and data sets."""
