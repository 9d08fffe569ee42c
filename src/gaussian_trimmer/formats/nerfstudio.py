"""Checkpoints of nerfstudio's splatfacto, `nerfstudio_models/step-<i>.ckpt`, read without torch.

The Gaussians are the tensors `gauss_params.means`, `.scales`, `.quats`, `.features_dc`, `.features_rest` and
`.opacities` of the model; checkpoints of before 1.1 lack the `gauss_params`. They lie in the coordinates of the
training, which nerfstudio turns, centres and scales (see `camera_files.nerfstudio_world`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import torch_files
from gaussian_trimmer.formats.packing import sh_dc_of
from gaussian_trimmer.gaussians import Gaussians, sigmoid

_ATTRIBUTES = ("means", "scales", "quats", "features_dc", "features_rest", "opacities")
_EXPECTED = "checkpoint of nerfstudio's splatfacto"


def read(path: Path) -> Gaussians:
    """Return the Gaussians of a checkpoint, rows in the order of the training.

    `ns-export` leaves out Gaussians whose numbers are not finite or that are nearly invisible; here every row counts.

    Raises:
        InputError: the file cannot be read, or is not a checkpoint of splatfacto.
    """
    file = torch_files.load(path)
    gaussians = torch_files.as_gaussians(file, _gaussian_tensors(file.value, path), _EXPECTED)
    if gaussians.sh_degree == 0:  # without higher degrees, splatfacto trains logits of colours instead
        gaussians = gaussians.replace(sh_dc=sh_dc_of(sigmoid(gaussians.sh_dc)))
    return gaussians


def _gaussian_tensors(value: Any, path: Path) -> dict[str, Any]:
    """Return the model's tensors by the names of `_ATTRIBUTES`."""
    state = value.get("pipeline") if isinstance(value, dict) else None
    if not isinstance(state, dict):
        raise InputError(f"'{path}' is not a {_EXPECTED}: it has no 'pipeline'.")
    starts = [str(name).removesuffix("means") for name in state if str(name).endswith("means")]
    found = [start for start in starts if all(torch_files.is_tensor(state.get(start + name)) for name in _ATTRIBUTES)]
    if len(found) != 1:
        raise InputError(
            f"'{path}' is not a {_EXPECTED}: {len(found)} of its models have means, scales and all that Gaussians have."
        )
    return {name: state[found[0] + name] for name in _ATTRIBUTES}
