"""Importing PyTorch and gsplat, late and with a cure for what may be missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from gaussian_trimmer.errors import InputError

_INSTALL = 'run: pip install "gaussian-trimmer[cuda]", or render with --renderer numba.'


def import_gsplat(device: str) -> tuple[Any, Any]:
    """Return the modules torch and gsplat, with the kernels of gsplat loaded; compiles them if this was never done.

    Raises:
        InputError: a library, the device or the kernels are missing.
    """
    try:
        torch, gsplat = import_module("torch"), import_module("gsplat")
    except ImportError as error:
        raise InputError(f"The gsplat renderer needs PyTorch and gsplat ({error}); {_INSTALL}") from error
    if device.startswith("cuda") and not torch.cuda.is_available():
        raise InputError(
            "The gsplat renderer needs a CUDA device, and PyTorch finds none here; render with --renderer numba."
        )
    try:
        kernels = import_module("gsplat.cuda._backend")._C
    except (ImportError, OSError, RuntimeError) as error:
        raise InputError(_no_kernels(str(error).strip().partition("\n")[0])) from error
    if kernels is None:
        raise InputError(_no_kernels("there is no CUDA toolkit"))
    return torch, gsplat


def _no_kernels(reason: str) -> str:
    return (
        f"gsplat cannot compile its CUDA kernels ({reason}); install the CUDA toolkit that PyTorch was built for, "
        "or a wheel of gsplat with compiled kernels, or render with --renderer numba."
    )
