"""Geometry that several stages use: bounds, the support plane, nearest neighbours, connected components."""
