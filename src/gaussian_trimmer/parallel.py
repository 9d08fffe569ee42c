"""One parallel kernel at a time."""

import threading

KERNELS = threading.Lock()
"""Held while a parallel kernel runs: Numba's fallback threading layer aborts the process on concurrent entry."""
