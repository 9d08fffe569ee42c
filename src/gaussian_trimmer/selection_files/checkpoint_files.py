"""Training checkpoints of 3D Gaussian Splatting and its relatives: a tuple of tensors, usually with the iteration.

The original tuple has 12 entries: SH degree, centres, f_dc, f_rest, scales, rotations, opacities, then statistics and
the optimizer. Methods that segment insert one entry at place 7, which makes 13.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import torch_files
from gaussian_trimmer.formats.checks import check_values
from gaussian_trimmer.formats.torch_files import TorchFile
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import is_file, reading

_PLAIN_LENGTH, _EXTENDED_LENGTH = 12, 13
_ENTRIES = ("means", "features_dc", "features_rest", "scales", "quats", "opacities")
_EXPECTED = "checkpoint of 3D Gaussian Splatting"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """The Gaussians of a checkpoint, and what a segmentation method added to each."""

    gaussians: Gaussians
    iteration: int | None
    """Training iteration, where the file says it."""
    extra: NDArray[Any] | None
    """Entry 7 of a 13-tuple, (N,), (N, 3) or (N, 1, D); None in a plain checkpoint."""

    @property
    def logits(self) -> NDArray[Any] | None:
        """COB-GS's foreground logits, (N,), if that is what the method added."""
        return self.extra if self.extra is not None and self.extra.ndim == 1 else None

    @property
    def features(self) -> NDArray[Any] | None:
        """Identity features of Gaussian Grouping or OmniSeg3D-GS, (N, D), if that is what the method added."""
        if self.extra is None or self.extra.ndim != 3:
            return None
        return self.extra.reshape(len(self.extra), -1)


def is_checkpoint(value: Any) -> bool:
    """Whether what a torch file holds looks like a checkpoint rather than like tensors of another use."""
    state = _state(value)
    return state is not None and len(state) in (_PLAIN_LENGTH, _EXTENDED_LENGTH)


def parse_checkpoint(file: TorchFile) -> Checkpoint:
    """Gaussians and extra entry of a checkpoint.

    Raises:
        InputError: entries are missing, have other shapes than the original's, or are not finite.
    """
    path, state = file.path, _state(file.value)
    assert state is not None
    tensors = state[1 : 8 if len(state) == _EXTENDED_LENGTH else 7]
    if not all(torch_files.is_tensor(entry) for entry in tensors):
        raise InputError(f"'{path}' is no {_EXPECTED}: entries 1 to 6 are not all tensors.")
    gaussians = torch_files.as_gaussians(file, dict(zip(_ENTRIES, tensors, strict=False)), _EXPECTED)
    check_values(gaussians, path)
    extra = torch_files.as_array(file, tensors[6]) if len(tensors) > 6 else None
    if extra is not None and (extra.ndim == 0 or len(extra) != len(gaussians)):
        raise InputError(f"'{path}' has an entry of shape {extra.shape} at place 7; {len(gaussians)} rows are needed.")
    return Checkpoint(gaussians, _iteration(file.value), extra)


@np.errstate(over="ignore", invalid="ignore")  # what becomes infinite is found by the check of values
def read_checkpoint(path: str | Path) -> Checkpoint:
    """The checkpoint in a .pth file, for instance to save its Gaussians as a PLY.

    Raises:
        InputError: the file cannot be read, or holds no checkpoint.
    """
    path = Path(path)
    if not is_file(path):
        raise InputError(f"There is no file '{path}'.")
    with reading(path):
        file = torch_files.load(path)
        if not is_checkpoint(file.value):
            raise InputError(f"'{path}' holds no checkpoint: no tuple of 12 or 13 entries, alone or with an iteration.")
        return parse_checkpoint(file)


def _state(value: Any) -> tuple[Any, ...] | None:
    if isinstance(value, (tuple, list)) and len(value) == 2 and isinstance(value[0], (tuple, list)):
        return tuple(value[0])
    return tuple(value) if isinstance(value, (tuple, list)) else None


def _iteration(value: Any) -> int | None:
    return value[1] if len(value) == 2 and isinstance(value[1], int) else None
