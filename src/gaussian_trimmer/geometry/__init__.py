"""Boxes, planes, neighbours, pieces and cuts, in scene coordinates."""

import os

from gaussian_trimmer.errors import InputError


def _check_threads() -> None:
    """Refuse a number with which Numba, which is imported later, ends in a traceback."""
    value = os.environ.get("NUMBA_NUM_THREADS", "1").strip()
    if not value.isdecimal() or int(value) < 1:
        raise InputError(f"The environment has NUMBA_NUM_THREADS={value}; set it to 1 or more, or unset it.")


_check_threads()
