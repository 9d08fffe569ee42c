"""Folders that trainings leave: which of their files holds the scene.

- Inria's code and those built on it, as Gaussian Grouping: `point_cloud/iteration_<i>/point_cloud.ply`
- nerfstudio: an export, `splat.ply` or `point_cloud.ply`, or else `nerfstudio_models/step-<i>.ckpt`
- gsplat's trainer: `ckpts/ckpt_<i>_rank0.pt`; Inria's checkpoints, COB-GS's and NG-GS's: `chkpnt<i>.pth`
- an unbundled SOG: `meta.json` and its textures; a streamed one: `lod-meta.json`
"""

from __future__ import annotations

import re
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import FORMATS, STREAMED

_ITERATION_NAME = re.compile(r"iteration_(?:[a-z]+_)?(\d{1,12})")
_SPLAT_NAMES = ("point_cloud.ply", "scene_point_cloud.ply", "splat.ply")
_CHECKPOINT_FOLDERS = ("nerfstudio_models", "ckpts")
_CHECKPOINT_NAME = re.compile(r"(?:step-|chkpnt|ckpt_)(\d{1,12})(?:_rank0)?\.(?:ckpt|pth|pt)")


def latest_splats(folder: Path) -> Path:
    """Return the splat file of the latest iteration in a training's folder, or the only one that a folder holds.

    Raises:
        InputError: there is none, or there are several.
    """
    if (folder / STREAMED).is_file():
        return folder / STREAMED
    for place in (folder / "point_cloud", folder):
        iterations = [
            (int(found[1]), path) for path in _entries(place) if (found := _ITERATION_NAME.fullmatch(path.name))
        ]
        for _, path in sorted(iterations, reverse=True):
            for name in _SPLAT_NAMES:
                if (path / name).is_file():
                    return path / name
    named = [folder / name for name in _SPLAT_NAMES if (folder / name).is_file()]
    if len(named) == 1:
        return named[0]
    if (folder / "meta.json").is_file() and any(path.suffix == ".webp" for path in _entries(folder)):
        return folder / "meta.json"
    splats = named or [
        path for path in _entries(folder) if path.name.lower().endswith(tuple(FORMATS)) and path.is_file()
    ]
    if len(splats) == 1:
        return splats[0]
    if splats:
        names = ", ".join(sorted(path.name for path in splats)[:8])
        raise InputError(f"The folder '{folder}' holds several splat files ({names}); give one of them.")
    for place in (*(folder / name for name in _CHECKPOINT_FOLDERS), folder):
        steps = [(int(found[1]), path) for path in _entries(place) if (found := _CHECKPOINT_NAME.fullmatch(path.name))]
        if steps:
            return max(steps)[1]
    raise InputError(
        f"The folder '{folder}' holds no splat file, no point_cloud/iteration_* and no checkpoint such as "
        f"{_CHECKPOINT_FOLDERS[0]}/step-*.ckpt; give the folder of a training or a splat file."
    )


def _entries(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []
