"""Training checkpoints of 3D Gaussian Splatting and its relatives, `.pth`, `.pt` and `.ckpt`, read without torch.

Inria's `chkpnt<i>.pth` is a tuple, usually with the iteration. The original has 12 entries: SH degree, centres, f_dc,
f_rest, scales, rotations, opacities, then statistics and the optimizer. Methods that segment insert one entry at place
7, which makes 13. gsplat's `ckpt_<i>_rank0.pt` is a dict of a `step` and of `splats`, tensors by name.

nerfstudio's splatfacto writes `nerfstudio_models/step-<i>.ckpt`, with the tensors `gauss_params.means`, `.scales`,
`.quats`, `.features_dc`, `.features_rest` and `.opacities` of the model; checkpoints of before 1.1 lack the
`gauss_params`. They lie in the coordinates of the training, which nerfstudio turns, centres and scales.

gaussian-splatting-lightning, and CityGaussian on it, write `checkpoints/epoch=<e>-step=<i>.ckpt`, with the tensors
`gaussian_model.gaussians.means`, `.scales`, `.rotations`, `.shs_dc`, `.shs_rest`, `.opacities`, perhaps `.filter_3d`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import torch_files
from gaussian_trimmer.formats.packing import sh_dc_of
from gaussian_trimmer.formats.torch_files import TorchFile
from gaussian_trimmer.gaussians import Gaussians, sigmoid

_PLAIN_LENGTH, _EXTENDED_LENGTH = 12, 13
_ENTRIES = ("means", "features_dc", "features_rest", "scales", "quats", "opacities")
_GSPLAT_ENTRIES = ("means", "sh0", "shN", "scales", "quats", "opacities")
_EXPECTED = "checkpoint of 3D Gaussian Splatting"
_ATTRIBUTES = ("means", "scales", "quats", "features_dc", "features_rest", "opacities")
_LIGHTNING = ("means", "scales", "rotations", "shs_dc", "shs_rest", "opacities")
"""The same in gaussian-splatting-lightning."""
_NAMED = "checkpoint of nerfstudio's splatfacto or of gaussian-splatting-lightning"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """The Gaussians of a checkpoint, and what a segmentation method added to each."""

    gaussians: Gaussians
    """With identity features of Gaussian Grouping or OmniSeg3D-GS as columns obj_dc_*."""
    iteration: int | None
    """Training iteration, where the file says it."""
    extra: NDArray[Any] | None
    """Entry 7 of a 13-tuple, (N,) as COB-GS's foreground logits, (N, 3) or (N, 1, D); None in a plain checkpoint."""

    @property
    def logits(self) -> NDArray[Any] | None:
        """COB-GS's foreground logits, (N,), if that is what the method added."""
        return self.extra if self.extra is not None and self.extra.ndim == 1 else None


def read(path: Path) -> Gaussians:
    """The Gaussians of a checkpoint, rows in the order of the training, with identity features as columns obj_dc_*.

    Raises:
        InputError: the file cannot be read, or holds no checkpoint.
    """
    if path.suffix.lower() == ".ckpt":
        return _read_named(path)
    if "_rank0" in path.name and path.with_name(path.name.replace("_rank0", "_rank1")).is_file():
        raise InputError(
            f"'{path}' holds one GPU's part of a scene that several trained; have gsplat's trainer write the whole one "
            "as a PLY, with --save_ply."
        )
    file = torch_files.load(path)
    if not is_checkpoint(file.value):
        raise InputError(
            f"'{path}' holds a {torch_files.type_name(file.value)} and no scene: neither a checkpoint of 12 or 13 "
            f"entries nor {', '.join(_GSPLAT_ENTRIES)} by name. Of other checkpoints, give the point_cloud.ply "
            "that the method wrote beside; a selection is given after its scene."
        )
    return parse_checkpoint(file).gaussians


def is_checkpoint(value: Any) -> bool:
    """Return whether what a torch file holds looks like a checkpoint rather than like tensors of another use."""
    state = _state(value)
    return _splats(value) is not None or (state is not None and len(state) in (_PLAIN_LENGTH, _EXTENDED_LENGTH))


def parse_checkpoint(file: TorchFile) -> Checkpoint:
    """Gaussians, whose values are not yet checked, and extra entry of a checkpoint.

    Raises:
        InputError: entries are missing, or have other shapes than the original's.
    """
    if (splats := _splats(file.value)) is not None:
        named = dict(zip(_ENTRIES, (splats[name] for name in _GSPLAT_ENTRIES), strict=True))
        step = file.value.get("step")
        gaussians = torch_files.as_gaussians(file, named, _EXPECTED)
        return Checkpoint(gaussians, step if isinstance(step, int) else None, None)
    path, state = file.path, _state(file.value)
    assert state is not None
    tensors = state[1 : 8 if len(state) == _EXTENDED_LENGTH else 7]
    if not all(torch_files.is_tensor(entry) for entry in tensors):
        raise InputError(f"'{path}' is not a {_EXPECTED}: entries 1 to 6 are not all tensors.")
    gaussians = torch_files.as_gaussians(file, dict(zip(_ENTRIES, tensors, strict=False)), _EXPECTED)
    extra = torch_files.as_array(file, tensors[6]) if len(tensors) > 6 else None
    if extra is not None and (extra.ndim == 0 or len(extra) != len(gaussians)):
        raise InputError(f"'{path}' has an entry of shape {extra.shape} at place 7; {len(gaussians)} rows are needed.")
    if extra is not None and extra.ndim == 3:
        features = extra.reshape(len(extra), -1).T
        gaussians = gaussians.replace(extras={f"obj_dc_{i}": column for i, column in enumerate(features)})
    iteration = file.value[1] if _with_iteration(file.value) else None
    return Checkpoint(gaussians, iteration if isinstance(iteration, int) else None, extra)


def _splats(value: Any) -> dict[str, Any] | None:
    """Return the tensors of gsplat's checkpoint by name, or of its splats alone."""
    splats = value.get("splats", value) if isinstance(value, dict) else None
    named = isinstance(splats, dict) and all(torch_files.is_tensor(splats.get(name)) for name in _GSPLAT_ENTRIES)
    return splats if named else None


def _state(value: Any) -> tuple[Any, ...] | None:
    """Return the entries of Inria's checkpoint, which usually stands before its iteration."""
    state = value[0] if _with_iteration(value) else value
    return tuple(state) if isinstance(state, (tuple, list)) else None


def _with_iteration(value: Any) -> bool:
    return isinstance(value, (tuple, list)) and len(value) == 2 and isinstance(value[0], (tuple, list))


def _read_named(path: Path) -> Gaussians:
    """Return the Gaussians of a checkpoint with tensors by name, rows in the order of the training.

    `ns-export` leaves out Gaussians whose numbers are not finite or that are nearly invisible; here every row counts.

    Raises:
        InputError: the file cannot be read, or is not such a checkpoint.
    """
    file = torch_files.load(path)
    parts = [file.value.get(key) for key in ("pipeline", "state_dict")] if isinstance(file.value, dict) else []
    state = next((part for part in parts if isinstance(part, dict)), None)
    if state is None:
        raise InputError(f"'{path}' is not a {_NAMED}: it has no 'pipeline' and no 'state_dict'.")
    starts = [str(name).removesuffix("means") for name in state if str(name).endswith("means")]
    found = [
        (start, names)
        for start in starts
        for names in (_ATTRIBUTES, _LIGHTNING)
        if all(torch_files.is_tensor(state.get(start + name)) for name in names)
    ]
    if len(found) != 1:
        raise InputError(f"'{path}' is not a {_NAMED}: {len(found)} of its models have all that Gaussians have.")
    ((start, names),) = found
    tensors = {name: state[start + own] for name, own in zip(_ATTRIBUTES, names, strict=True)}
    gaussians = torch_files.as_gaussians(file, tensors, _NAMED)
    if gaussians.sh_degree == 0 and names == _ATTRIBUTES:
        # Without higher degrees, splatfacto trains logits of colours instead.
        return gaussians.replace(sh_dc=sh_dc_of(sigmoid(gaussians.sh_dc)))
    if torch_files.is_tensor(widths := state.get(f"{start}filter_3d")):
        return gaussians.replace(extras={"filter_3D": torch_files.as_array(file, widths).reshape(len(gaussians))})
    return gaussians
