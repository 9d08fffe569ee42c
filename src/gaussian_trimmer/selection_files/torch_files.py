"""Files of torch.save, read without running anything that they contain.

Only zip archives without compression are taken (torch has written them since 1.6). They are memory-mapped, so a
checkpoint's optimizer state costs nothing.
"""

from __future__ import annotations

import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError

SUFFIXES = (".pt", ".pth")
_MAX_PICKLE_BYTES = 1 << 24
# Before this version, weights_only did not keep files from running code (CVE-2025-32434).
_OLDEST_SAFE_TORCH = (2, 6)


def load(path: Path) -> Any:
    """The tensors, containers and numbers of a torch file; tensors lie on the CPU, as views onto the file.

    Raises:
        InputError: torch is missing or too old, or the file is damaged, of the old format, or holds other objects.
    """
    torch = _import_torch(path)
    _check_archive(path)
    try:
        with torch.serialization.safe_globals(_number_globals()):
            return torch.load(str(path), map_location="cpu", weights_only=True, mmap=True)
    except MemoryError:
        raise
    except Exception as error:  # whatever a strange file makes torch raise, the file is at fault
        raise InputError(
            f"'{path}' is damaged or holds more than tensors and numbers, and other objects are not loaded because "
            "they can run code; save the tensors alone with torch.save."
        ) from error


def as_array(tensor: Any, path: Path) -> NDArray[Any]:
    """A dense tensor as an array that shares its memory; bfloat16 becomes float32.

    Raises:
        InputError: the tensor is sparse or quantised, or a small storage is expanded to more than the file holds.
    """
    import torch

    if tensor.layout is not torch.strided or tensor.is_quantized or tensor.device.type != "cpu":
        raise InputError(f"'{path}' holds a sparse or quantised tensor; save it as a dense one.")
    if tensor.numel() * tensor.element_size() > path.stat().st_size:
        raise InputError(f"'{path}' holds an expanded tensor of shape {tuple(tensor.shape)}; save a contiguous one.")
    tensor = tensor.detach()
    return np.asarray((tensor.float() if tensor.dtype is torch.bfloat16 else tensor).numpy())


def is_tensor(value: Any) -> bool:
    """Whether a loaded value is a tensor or parameter."""
    import torch

    return isinstance(value, torch.Tensor)


def _import_torch(path: Path) -> Any:
    try:
        torch: Any = import_module("torch")
    except ImportError as error:
        raise InputError(
            f"'{path.name}' can only be read with torch; install it with: pip install \"gaussian-trimmer[torch]\""
        ) from error
    if tuple(int(part) for part in torch.__version__.split(".")[:2]) < _OLDEST_SAFE_TORCH:
        raise InputError(
            f"torch {torch.__version__} does not read files from others safely; update it to 2.6 or later with: "
            "pip install --upgrade torch"
        )
    return torch


def _check_archive(path: Path) -> None:
    """Refuse what torch would unpack to more than the file's own size."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise InputError(
            f"'{path}' is no torch file of the zip format, or is damaged; load it and save it again with torch.save."
        ) from error
    compressed = any(entry.compress_type != zipfile.ZIP_STORED for entry in entries)
    if compressed or sum(entry.file_size for entry in entries) > path.stat().st_size:
        raise InputError(f"'{path}' is a compressed or damaged archive, which torch.save does not write.")
    if any(entry.filename.endswith(".pkl") and entry.file_size > _MAX_PICKLE_BYTES for entry in entries):
        raise InputError(f"'{path}' holds a structure of more than {_MAX_PICKLE_BYTES >> 20} MB beside its tensors.")


class _NumberType:
    """Stands in for numpy.dtype in a file: keeps the code of a number and drops everything else."""

    def __init__(self, code: str, *_: object) -> None:
        if code not in ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1"):
            raise ValueError(f"{code!r} is no number type.")
        self.code = code
        self.byte_order = "<"

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.byte_order = ">" if state[1] == ">" else "<"


def _number(kind: _NumberType, data: bytes) -> Any:
    """Stands in for the function that rebuilds a NumPy scalar."""
    return np.frombuffer(data, kind.byte_order + kind.code, count=1)[0].item()


def _number_globals() -> list[tuple[Any, str]]:
    # Learning rates and scene extents in the optimizer's state are often NumPy scalars. NumPy's own functions would
    # accept states that corrupt memory, so these two names are bound to the harmless stand-ins above.
    return [
        (_NumberType, "numpy.dtype"),
        (_number, "numpy.core.multiarray.scalar"),
        (_number, "numpy._core.multiarray.scalar"),
    ]
