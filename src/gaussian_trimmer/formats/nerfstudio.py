"""Checkpoints of nerfstudio's splatfacto, `nerfstudio_models/step-<i>.ckpt`, read without torch.

The Gaussians are the tensors `gauss_params.means`, `.scales`, `.quats`, `.features_dc`, `.features_rest` and
`.opacities` of the model; checkpoints of before 1.1 lack the `gauss_params`. They lie in the coordinates of the
training, which nerfstudio turns, centres and scales (see `camera_files.nerfstudio_world`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import torch_files
from gaussian_trimmer.formats.packing import sh_dc_of, with_finite_limits
from gaussian_trimmer.gaussians import FloatArray, Gaussians, sigmoid

_ATTRIBUTES = ("means", "scales", "quats", "features_dc", "features_rest", "opacities")
_COEFFICIENTS = (0, 3, 8, 15)


def read(path: Path) -> Gaussians:
    """The Gaussians of a checkpoint, rows in the order of the training.

    `ns-export` leaves out Gaussians whose numbers are not finite or that are nearly invisible; here every row counts.

    Raises:
        InputError: the file cannot be read, is no checkpoint of splatfacto, or holds values that are not finite.
    """
    file = torch_files.load(path)
    tensors = _gaussian_tensors(file.value, path)
    arrays = torch_files.as_arrays(file, tensors)
    values = {name: np.asarray(array, np.float32) for name, array in arrays.items()}
    n, rest = len(values["means"]) if values["means"].ndim else 0, values["features_rest"]
    if n == 0:
        raise InputError(f"'{path}' holds zero Gaussians.")
    if rest.size == 0:
        rest = rest.reshape(n, 0, 3)
    fits = rest.ndim == 3 and rest.shape[::2] == (n, 3) and rest.shape[1] in _COEFFICIENTS
    if not fits or values["opacities"].size != n:
        raise _foreign(path, f"its colours and opacities do not fit its {n} Gaussians")
    try:
        gaussians = Gaussians(
            means=values["means"],
            log_scales=values["scales"],
            quaternions=values["quats"],
            opacity_logits=values["opacities"].reshape(n),
            sh_dc=_degree_0(values["features_dc"], rest.shape[1]),
            sh_rest=np.ascontiguousarray(rest.transpose(0, 2, 1)),
        )
    except ValueError as error:
        raise _foreign(path, str(error)) from error
    return with_finite_limits(gaussians)


def _degree_0(features: FloatArray, rest: int) -> FloatArray:
    """Coefficients of degree 0; without higher degrees, splatfacto trains logits of colours instead."""
    return features if rest else sh_dc_of(sigmoid(features))


def _gaussian_tensors(value: Any, path: Path) -> dict[str, Any]:
    """The model's tensors by the names of `_ATTRIBUTES`."""
    state = value.get("pipeline") if isinstance(value, dict) else None
    if not isinstance(state, dict):
        raise _foreign(path, "it has no 'pipeline'")
    starts = [str(name).removesuffix("means") for name in state if str(name).endswith("means")]
    found = [start for start in starts if all(torch_files.is_tensor(state.get(start + name)) for name in _ATTRIBUTES)]
    if len(found) != 1:
        raise _foreign(path, f"{len(found)} of its models have means, scales and all that Gaussians have")
    return {name: state[found[0] + name] for name in _ATTRIBUTES}


def _foreign(path: Path, why: str) -> InputError:
    return InputError(f"'{path}' is no checkpoint of nerfstudio's splatfacto: {why}.")
