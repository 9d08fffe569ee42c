"""SPIn-NeRF's masks for segmentation in many views: one object a scene, masks of some or all of its pictures.

    ROOT/<scene>/<picture>.png, or in <scene>/masks/, <scene>/label/ or <scene>/images_4/label/

Masks are 0 and 255, or 0 and 1. What a labelling tool leaves beside them, `<picture>_cutout` and `<picture>_pseudo`, is
left out. The score is the mean over a scene's masks, then over scenes.
"""

from __future__ import annotations

from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.layouts.layout import (
    Layout,
    LayoutTask,
    Published,
    Target,
    folders_in,
    pictures_in,
)

_NO_MASKS = ("_cutout", "_pseudo")


def find_tasks(root: Path) -> list[LayoutTask]:
    """The tasks below a folder; see `Layout.find_tasks`."""
    tasks = [LayoutTask(folder.name, folder.name, _targets(folder)) for folder in folders_in(root)]
    tasks = [task for task in tasks if task.targets]
    if not tasks:
        raise InputError(
            f"'{root}' has no masks '<scene>/<picture>.png', nor in 'masks' or 'label' of a scene; give the folder "
            "that holds the scenes."
        )
    return tasks


def _targets(scene: Path) -> tuple[Target, ...]:
    labels = [folder / "label" for folder in folders_in(scene) if folder.name.startswith("images")]
    for folder in (scene / "masks", scene / "label", *labels, scene):
        masks = [path for path in pictures_in(folder) if not path.stem.endswith(_NO_MASKS)]
        if masks:
            return tuple(Target(path.stem, path) for path in masks)
    return ()


_PUBLISHED = (Published("MVSeg", 90.9, 98.8, "usual", "SPIn-NeRF (Mirzaei et al., CVPR 2023)"),)
# The published means are of the ten scenes that come with the masks.
LAYOUT = Layout("SPIn-NeRF", find_tasks, expected=10, published=_PUBLISHED)
