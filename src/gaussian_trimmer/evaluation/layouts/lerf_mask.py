"""LERF-Mask, and 3D-OVS, whose folder of masks has another name.

LERF-Mask: objects named by words in the scenes figurines, ramen and teatime, in two to four pictures each.

    ROOT/<scene>/test_mask/<view>/<words>.png   a mask
    ROOT/<scene>/images/                        all pictures
    ROOT/<scene>/images_train/                  all but the test pictures

`<view>` is the name of a picture, or the number, from 0, of a test picture in the order of their names. The score is
the mean over views for each object, over objects for each scene, and over scenes. Of 3D-OVS:

    ROOT/<scene>/segmentations/<view>/<words>.png
    ROOT/<scene>/images/
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.layouts.layout import Layout, LayoutTask, Target, folders_in, pictures_in


def find_tasks(root: Path, masks: str = "test_mask") -> list[LayoutTask]:
    """The tasks below a folder; see `Layout.find_tasks`."""
    scenes = [folder for folder in folders_in(root) if (folder / masks).is_dir()]
    if not scenes:
        raise InputError(f"'{root}' has no folders '<scene>/{masks}'; give the folder with the scenes.")
    return [task for scene in scenes for task in _tasks_of(scene, masks)]


def _tasks_of(scene: Path, masks: str) -> list[LayoutTask]:
    targets: dict[str, list[Target]] = {}
    for folder in folders_in(scene / masks):
        picture = _picture(scene, folder.name, masks)
        for mask in pictures_in(folder):
            targets.setdefault(mask.stem, []).append(Target(picture.stem, mask, picture))
    if not targets:
        raise InputError(f"'{scene / masks}' holds no masks '<view>/<words>.png'.")
    return [LayoutTask(scene.name, words, tuple(found)) for words, found in sorted(targets.items())]


def _picture(scene: Path, view: str, masks: str) -> Path:
    """The picture that the masks of a folder belong to."""
    pictures = pictures_in(scene / "images")
    named = [path for path in pictures if view in (path.name, path.stem)]
    if len(named) == 1:
        return named[0]
    training = {path.stem for path in pictures_in(scene / "images_train")}
    test = [path for path in pictures if path.stem not in training]
    if not (view.isascii() and view.isdigit()) or not training or int(view) >= len(test):
        raise InputError(
            f"The masks in '{scene / masks / view}' belong to no known picture: 'images' has none of that name, "
            f"and without those of 'images_train' it has {len(test)} test pictures."
        )
    return test[int(view)]


LAYOUT = Layout("LERF-Mask", find_tasks, expected=23, mean_by_scene=True, second="boundary_iou")
OVS_3D = Layout("3D-OVS", partial(find_tasks, masks="segmentations"), expected=None, mean_by_scene=True)
