"""NVOS: eight objects in the scenes of LLFF, one target picture each.

    ROOT/masks/<task>/<picture>_mask.png        the target's mask, of any size, PNG or JPEG
    ROOT/masks/<task>/<picture>.jpg             the target itself, if it is there

The target is the picture that the mask is named after, which is not the first test picture of the scene.
`horns_center` and `horns_left` share a scene. The score is the unweighted mean over the tasks.
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

_MASK_ENDING = "_mask"
_SHARED_SCENES = {"horns_center": "horns", "horns_left": "horns"}
_COB_GS = ((68.2, 69.5), (73.1, 74.2), (85.9, 86.7))
_PUBLISHED = (
    Published("SA3D", 90.3, 98.2, "sa3d", trimmed_iou=91.9, trimmed_second=98.5),
    Published(
        "SAGD", 90.4, 98.2, trimmed_iou=92.0, trimmed_second=98.5, looks=((62.1, 68.8), (63.1, 73.8), (78.8, 83.5))
    ),
    Published("SAGA", 90.9, 98.3, "saga", trimmed_iou=92.1, trimmed_second=98.5),
    Published("OmniSeg3D", 91.7, 98.4, trimmed_iou=92.4, trimmed_second=98.7),
    Published("FlashSplat", 91.8, 98.6, trimmed_iou=92.2, trimmed_second=98.7),
    Published("COB-GS", 92.1, 98.6, "cob-gs", trimmed_iou=92.5, trimmed_second=98.7, looks=_COB_GS),
    Published("NG-GS", 92.6, 99.2, "cob-gs", "NG-GS (He et al., CVPR 2026)"),
    Published("SAGOnline", 92.7, None, None, "SAGOnline"),
)
"""What the table of the GaussianTrimmer paper has, and two later methods."""


def find_tasks(root: Path) -> list[LayoutTask]:
    """The tasks below a folder; see `Layout.find_tasks`."""
    folders = folders_in(root / "masks")
    if not folders:
        raise InputError(f"'{root}' has no folders 'masks/<task>'; give the folder of NVOS that holds 'masks'.")
    return [
        LayoutTask(_SHARED_SCENES.get(folder.name, folder.name), folder.name, (_target(folder),)) for folder in folders
    ]


def _target(folder: Path) -> Target:
    pictures = pictures_in(folder)
    masks = [path for path in pictures if path.stem.endswith(_MASK_ENDING)]
    if len(masks) != 1:
        raise InputError(
            f"'{folder}' holds {len(masks)} target masks; one picture must be named '<target>{_MASK_ENDING}', as in "
            f"'IMG_4027{_MASK_ENDING}.png'."
        )
    name = masks[0].stem.removesuffix(_MASK_ENDING)
    images = [path for path in pictures if path.stem == name]
    return Target(name, masks[0], images[0] if len(images) == 1 else None)


LAYOUT = Layout("NVOS", find_tasks, expected=8, published=_PUBLISHED)
