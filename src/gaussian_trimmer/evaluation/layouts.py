"""Layouts of published data sets: their tasks, which are objects with masks in some pictures.

NVOS: eight objects in the scenes of LLFF, one target picture each, after which the mask is named; it is not the first
test picture of the scene. `horns_center` and `horns_left` share a scene.

    ROOT/masks/<task>/<picture>_mask.png        the target's mask, of any size, PNG or JPEG
    ROOT/masks/<task>/<picture>.jpg             the target itself, if it is there

LERF-Mask, and 3D-OVS with `segmentations` in place of `test_mask`: objects named by words in some pictures. `<view>` is
the name of a picture, or the number, from 0, of a test picture in the order of their names.

    ROOT/<scene>/test_mask/<view>/<words>.png   a mask
    ROOT/<scene>/images/                        all pictures
    ROOT/<scene>/images_train/                  all but the test pictures

SPIn-NeRF's masks for segmentation in many views: one object a scene, masks of 0 and 255 or 0 and 1. What a labelling
tool leaves beside them, `<picture>_cutout` and `<picture>_pseudo`, is left out.

    ROOT/<scene>/<picture>.png, or in <scene>/masks/, <scene>/label/ or <scene>/images_4/label/

LERF-OVS: objects named by words, as polygons in some pictures of the scenes of LERF.

    ROOT/label/<scene>/frame_00041.json         polygons, several of one object perhaps
    ROOT/<scene>/images/frame_00041.jpg         the picture, if it is there
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation import published
from gaussian_trimmer.evaluation.ground_truth import read_polygons
from gaussian_trimmer.evaluation.published import Published
from gaussian_trimmer.evaluation.runs import MeanOver

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings of masks and photographs, in lower case."""
_N_EXAMPLES = 3
_NVOS_ENDING, _NVOS_SCENES = "_mask", {"horns_center": "horns", "horns_left": "horns"}
_SPIN_NERF_LEFTOVERS = ("_cutout", "_pseudo")


@dataclass(frozen=True)
class MaskedPicture:
    """A picture with a mask."""

    view: str
    """Name of the picture without its ending."""
    mask: Path
    """Mask of the object in it."""
    image: Path | None = None
    """The picture itself, if it is there."""
    category: str | None = None
    """The object's name in a file of polygons; None if the mask is a picture."""


@dataclass(frozen=True)
class DatasetTask:
    """An object whose masks are known."""

    scene: str
    """Name of the scene; several tasks may share one."""
    object: str
    """Name of the object within the scene, or the scene's if it has one object."""
    pictures: tuple[MaskedPicture, ...]

    @property
    def name(self) -> str:
        """A name that no other task has."""
        return self.object if self.object.startswith(self.scene) else f"{self.scene}/{self.object}"


@dataclass(frozen=True)
class Layout:
    """A published data set."""

    title: str
    find_tasks: Callable[[Path], list[DatasetTask]]
    """The tasks below a folder, by name; InputError if it has another layout, or a task lacks its mask."""
    mean_over: MeanOver = "scenes"
    """The units of the published mean."""
    second: Literal["accuracy", "boundary_iou", "acc25"] = "accuracy"
    """The metric that is published beside IoU."""
    expected: int | None = None
    """Number of tasks that the published means are of; None if that is not known."""
    published: tuple[Published, ...] = ()


def find_nvos(root: Path) -> list[DatasetTask]:
    """Return the tasks of NVOS; see `Layout.find_tasks`."""
    tasks = []
    for folder in folders_in(root / "masks"):
        pictures = pictures_in(folder)
        masks = [path for path in pictures if path.stem.endswith(_NVOS_ENDING)]
        if len(masks) != 1:
            raise InputError(
                f"'{folder}' holds {len(masks)} target masks; one picture must be named '<target>{_NVOS_ENDING}', as "
                f"in 'IMG_4027{_NVOS_ENDING}.png'."
            )
        name = masks[0].stem.removesuffix(_NVOS_ENDING)
        images = [path for path in pictures if path.stem == name]
        picture = MaskedPicture(name, masks[0], images[0] if len(images) == 1 else None)
        tasks.append(DatasetTask(_NVOS_SCENES.get(folder.name, folder.name), folder.name, (picture,)))
    return _any_of(tasks, f"'{root}' has no folders 'masks/<task>'; give the folder of NVOS that holds 'masks'.")


def find_by_words(root: Path, masks: str) -> list[DatasetTask]:
    """Return the tasks of LERF-Mask or 3D-OVS, whose folders of masks have other names; see `Layout.find_tasks`."""
    tasks = []
    for scene in (folder for folder in folders_in(root) if (folder / masks).is_dir()):
        found: dict[str, list[MaskedPicture]] = {}
        for folder in folders_in(scene / masks):
            picture = _picture_of(scene, folder)
            for mask in pictures_in(folder):
                found.setdefault(mask.stem, []).append(MaskedPicture(picture.stem, mask, picture))
        if not found:
            raise InputError(f"'{scene / masks}' holds no masks '<view>/<words>.png'.")
        tasks += _tasks_by_words(scene.name, found)
    return _any_of(tasks, f"'{root}' has no folders '<scene>/{masks}'; give the folder with the scenes.")


def find_lerf_ovs(root: Path) -> list[DatasetTask]:
    """Return the tasks of LERF-OVS; see `Layout.find_tasks`."""
    tasks = []
    for folder in folders_in(root / "label"):
        images = {path.stem: path for path in pictures_in(root / folder.name / "images") or pictures_in(folder)}
        found: dict[str, list[MaskedPicture]] = {}
        for file in sorted(folder.glob("*.json")):
            for category in read_polygons(file)[1]:
                picture = MaskedPicture(file.stem, file, images.get(file.stem), category)
                found.setdefault(category, []).append(picture)
        tasks += _tasks_by_words(folder.name, found)
    return _any_of(tasks, f"'{root}' has no files 'label/<scene>/<picture>.json'; give the folder of LERF-OVS.")


def find_spin_nerf(root: Path) -> list[DatasetTask]:
    """Return the tasks of SPIn-NeRF; see `Layout.find_tasks`."""
    tasks = []
    for scene in folders_in(root):
        labels = [folder / "label" for folder in folders_in(scene) if folder.name.startswith("images")]
        for folder in (scene / "masks", scene / "label", *labels, scene):
            masks = [path for path in pictures_in(folder) if not path.stem.endswith(_SPIN_NERF_LEFTOVERS)]
            if masks:
                tasks.append(DatasetTask(scene.name, scene.name, tuple(MaskedPicture(m.stem, m) for m in masks)))
                break
    return _any_of(
        tasks,
        f"'{root}' has no masks '<scene>/<picture>.png', nor in 'masks' or 'label' of a scene; give the folder that "
        "holds the scenes.",
    )


def pictures_in(folder: Path) -> list[Path]:
    """Return the pictures directly in a folder, by name; none if there is no such folder."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES and path.is_file())


def folders_in(folder: Path) -> list[Path]:
    """Return the folders directly in a folder, by name; none if there is no such folder."""
    return sorted(path for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []


def camera_of(picture: MaskedPicture, cameras: Sequence[Camera], where: str) -> Camera:
    """Return the camera of a picture, by name; never by its number.

    Args:
        picture: the picture.
        cameras: all cameras of the scene.
        where: where the cameras come from, for the message.

    Raises:
        InputError: no camera has the name, or several have it.
    """
    found = [camera for camera in cameras if picture.view in (camera.name, Path(camera.name).stem)]
    if len(found) != 1:
        examples = ", ".join(clip_name(camera.name) for camera in cameras[:_N_EXAMPLES])
        raise InputError(
            f"'{picture.mask}' is a mask of '{clip_name(picture.view)}', and {len(found)} of the {len(cameras)} "
            f"cameras of {where} have that name; exactly one must. They are named {examples}, ..."
        )
    return found[0]


def _any_of(tasks: list[DatasetTask], otherwise: str) -> list[DatasetTask]:
    if not tasks:
        raise InputError(otherwise)
    return tasks


def _tasks_by_words(scene: str, found: dict[str, list[MaskedPicture]]) -> list[DatasetTask]:
    return [DatasetTask(scene, words, tuple(pictures)) for words, pictures in sorted(found.items())]


def _picture_of(scene: Path, folder: Path) -> Path:
    """Return the picture that the masks in a folder belong to."""
    pictures, view = pictures_in(scene / "images"), folder.name
    named = [path for path in pictures if view in (path.name, path.stem)]
    if len(named) == 1:
        return named[0]
    training = {path.stem for path in pictures_in(scene / "images_train")}
    test = [path for path in pictures if path.stem not in training]
    if not (view.isascii() and view.isdigit()) or not training or int(view) >= len(test):
        raise InputError(
            f"The masks in '{folder}' belong to no known picture: 'images' has none of that name, and without those of "
            f"'images_train' it has {len(test)} test pictures."
        )
    return test[int(view)]


LAYOUTS: dict[str, Layout] = {
    "nvos": Layout("NVOS", find_nvos, "objects", expected=8, published=published.NVOS),
    "lerf-mask": Layout("LERF-Mask", partial(find_by_words, masks="test_mask"), second="boundary_iou", expected=23),
    "spin-nerf": Layout("SPIn-NeRF", find_spin_nerf, "objects", expected=10, published=published.SPIN_NERF),
    "lerf-ovs": Layout("LERF-OVS", find_lerf_ovs, "scenes, by view", "acc25"),
    "3d-ovs": Layout("3D-OVS", partial(find_by_words, masks="segmentations"), second="acc25"),
}
