"""Boundary Gaussian Decomposition (BGD), the third stage: what belongs to the object, and what is split at its edge."""
