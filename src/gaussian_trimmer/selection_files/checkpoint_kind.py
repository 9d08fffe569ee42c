"""COB-GS's checkpoint `chkpnt<iteration>.pth`, in which entry 7 is a foreground logit a Gaussian.

Checkpoints of other methods hold no selection of their own; the message says how to get one.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, sigmoid
from gaussian_trimmer.selection_files.options import SelectionOptions, flag
from gaussian_trimmer.selection_files.selection_file import SelectionFile, mask_of_rows

PROBABILITY = 0.9
"""COB-GS's threshold on the sigmoid."""


def offers_checkpoint(file: SelectionFile, n: int, options: SelectionOptions) -> bool:
    """Whether the file is a checkpoint and nothing says that its features are to be used."""
    return file.checkpoint is not None and options.classifier is None and options.query_row is None


def select_checkpoint(file: SelectionFile, gaussians: Gaussians, options: SelectionOptions) -> BoolArray:
    """The Gaussians whose foreground probability is above the threshold, (N,).

    Raises:
        InputError: the checkpoint holds no logits, or its Gaussians are not the scene's.
    """
    name = file.path.name
    if file.checkpoint is None:
        raise InputError(f"'{name}' holds no training checkpoint.")
    if file.checkpoint.extra is None:
        raise InputError(f"'{name}' is a checkpoint of plain 3D Gaussian Splatting, which holds no selection.")
    if file.checkpoint.features is not None:
        raise InputError(
            f"'{name}' holds identity features; add {flag('classifier')} classifier.pth and {flag('object_id')}, or "
            f"{flag('query_row')}."
        )
    if file.checkpoint.logits is None:
        shape = file.checkpoint.extra.shape
        raise InputError(
            f"'{name}' holds language features {shape}, which select no Gaussians (LangSplat answers a query with "
            "masks of images); lift such masks to the scene with 'gaussian-trimmer select'."
        )
    probabilities = sigmoid(np.asarray(file.checkpoint.logits, np.float32))
    chosen = probabilities > (PROBABILITY if options.threshold is None else options.threshold)
    return mask_of_rows(file.scene_rows(gaussians)[chosen], len(gaussians))
