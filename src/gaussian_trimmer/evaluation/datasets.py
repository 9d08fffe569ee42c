"""Published data sets: their tasks, and the rules by which published codes measure on them.

NVOS: eight objects in the scenes of LLFF, one target picture each, after which the mask is named; it is not the first
test picture of the scene. `horns_center` and `horns_left` share a scene.

    ROOT/masks/<task>/<picture>_mask.png        the target's mask, of any size, PNG or JPEG
    ROOT/masks/<task>/<picture>.jpg             the target itself, if it is there

LERF-Mask: objects named by words in some pictures. `<view>` is the name of a picture, or the number, from 0, of a test
picture in the order of their names.

    ROOT/<scene>/test_mask/<view>/<words>.png   a mask
    ROOT/<scene>/images/                        all pictures
    ROOT/<scene>/images_train/                  all but the test pictures

LERF-OVS: objects named by words, as polygons in some pictures of the scenes of LERF.

    ROOT/label/<scene>/frame_00041.json         polygons, several of one object perhaps
    ROOT/<scene>/images/frame_00041.jpg         the picture, if it is there

Published codes differ in the size at which they render, the opacity that makes a mask, whether what hides the object
counts, and where they cut grey masks. So a figure can be compared with figures of the same protocol alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.ground_truth import TestView, at_size, read_polygons
from gaussian_trimmer.evaluation.metrics import THRESHOLD
from gaussian_trimmer.evaluation.scoring import RULES

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings of masks and photographs, in lower case."""
MeanOver = Literal["objects", "scenes", "scenes, by view"]
"""The units of a mean: objects, or scenes, whose own means are over objects or over all views of all objects."""
MEAN_NOTES: Mapping[MeanOver, str] = {
    "objects": "means over the views of a task, then over tasks",
    "scenes": "means over the views of a task, then over the objects of a scene, then over scenes",
    "scenes, by view": "means over all objects in all views of a scene, then over scenes",
}
OWN = "own"
"""Name of this program's own rules."""
_N_EXAMPLES = 3
_NVOS_ENDING, _NVOS_SCENES = "_mask", {"horns_center": "horns", "horns_left": "horns"}
_GREY, _TENTH_OF_255 = 128 / 255, 10 / 255


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
class Task:
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
class Protocol:
    """One way of measuring."""

    name: str
    title: str = ""
    """Where it is written, for tables."""
    rules: tuple[str, ...] = tuple(RULES)
    """The rules of occlusion that count."""
    threshold: float = THRESHOLD
    """Opacity above which a rendered pixel belongs to the object."""
    size: Literal["mask", "camera"] | int = "mask"
    """At which size views are rendered: that of the mask, of the camera, or this width in pixels; then they are brought
    to the mask's by the nearest pixel."""
    truth_above: float | None = None
    """Share of white above which a pixel of the ground truth's mask is object; None keeps greys as coverage."""

    def describe(self) -> str:
        """Return the rules in words, for tables."""
        sizes = {"mask": "at the size of their masks", "camera": "at the size of their cameras"}
        words = [f"views are rendered {sizes.get(str(self.size), f'{self.size} pixels wide')}"]
        words += ["enlarged to the mask by the nearest pixel"] if self.size != "mask" else []
        words += [f"mask: alpha > {self.threshold:g}"]
        words += [f"ground truth > {self.truth_above:g}" if self.truth_above is not None else "ground truth > 0.5"]
        return f"protocol {self.name} ({self.title}): {', '.join(self.rules)}; {'; '.join(words)}"

    def view(self, view: TestView, camera: Camera) -> TestView:
        """Return a view with ground truth, seen by its picture's own camera, as the protocol compares it."""
        if self.size != "mask":
            width = camera.width if self.size == "camera" else int(self.size)
            height = round(width * camera.height / camera.width)
            view = replace(view, camera=at_size(camera, width, height, Path(camera.name)))
        if self.truth_above is None:
            return view
        return replace(view, coverage=(view.coverage > self.truth_above).astype(np.float32))


@dataclass(frozen=True)
class Layout:
    """A published data set."""

    title: str
    find: Callable[[Path], list[Task]]
    """The tasks below a folder, by name, of which it has none if its layout is another."""
    where: str
    """What such a folder has, for the message."""
    protocols: tuple[Protocol, ...]
    """Of published codes. LLFF's pictures are 4032 pixels wide; COB-GS and SA3D take a quarter, and Inria's code, on
    which SAGA builds, reduces what is wider than 1600 pixels to that."""
    mean_over: MeanOver = "scenes"
    """The units of the published mean."""
    second: Literal["accuracy", "boundary_iou", "acc25"] = "accuracy"
    """The metric that is published beside IoU."""
    expected: int | None = None
    """Number of tasks that the published means are of; None if that is not known."""

    def find_tasks(self, root: Path, names: Sequence[str] = ()) -> list[Task]:
        """Return the tasks below a folder: those of the given names, or all if none is given.

        Raises:
            InputError: the folder has another layout, a task lacks its mask, or no task has such a name.
        """
        tasks = self.find(root)
        if not tasks:
            raise InputError(f"'{root}' has no {self.where}; give the folder of {self.title} that holds them.")
        known = {task.name for task in tasks}
        for name in names:
            if name not in known:
                raise InputError(f"There is no task '{name}' in '{root}'; available: {', '.join(sorted(known))}.")
        return [task for task in tasks if not names or task.name in names]

    def protocol(self, name: str) -> Protocol:
        """Return the protocol of that name.

        Raises:
            InputError: the data set has none of that name.
        """
        known = {protocol.name: protocol for protocol in (Protocol(OWN), *self.protocols)}
        if name not in known:
            raise InputError(f"There is no protocol '{name}' of {self.title}; available: {', '.join(known)}.")
        return known[name]


def find_nvos(root: Path) -> list[Task]:
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
        tasks.append(Task(_NVOS_SCENES.get(folder.name, folder.name), folder.name, (picture,)))
    return tasks


def find_lerf_mask(root: Path) -> list[Task]:
    """Return the tasks of LERF-Mask; see `Layout.find_tasks`."""

    def masks_of(scene: Path) -> Iterator[tuple[str, MaskedPicture]]:
        for folder in folders_in(scene / "test_mask"):
            picture = _picture_of(scene, folder)
            yield from ((mask.stem, MaskedPicture(picture.stem, mask, picture)) for mask in pictures_in(folder))

    return [task for scene in folders_in(root) for task in _tasks_by_words(scene.name, masks_of(scene))]


def find_lerf_ovs(root: Path) -> list[Task]:
    """Return the tasks of LERF-OVS; see `Layout.find_tasks`."""

    def masks_of(folder: Path) -> Iterator[tuple[str, MaskedPicture]]:
        images = {path.stem: path for path in pictures_in(root / folder.name / "images") or pictures_in(folder)}
        for file in sorted(folder.glob("*.json")):
            for words in read_polygons(file)[1]:
                yield words, MaskedPicture(file.stem, file, images.get(file.stem), words)

    return [task for folder in folders_in(root / "label") for task in _tasks_by_words(folder.name, masks_of(folder))]


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


def _tasks_by_words(scene: str, masks: Iterable[tuple[str, MaskedPicture]]) -> list[Task]:
    found: dict[str, tuple[MaskedPicture, ...]] = {}
    for words, picture in masks:
        found[words] = (*found.get(words, ()), picture)
    return [Task(scene, words, pictures) for words, pictures in sorted(found.items())]


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
    "nvos": Layout(
        "NVOS", find_nvos, "folders 'masks/<task>'",
        (
            Protocol("cob-gs", "ZestfulJX/COB-GS, render.py and eval/eval_NVOS.py", ("alone",), 0.5, 1008, _GREY),
            Protocol("saga", "Jumpat/SegAnyGAussians, render.py and utils/camera_utils.py; where masks are cut is "
                     "assumed", ("in scene",), 0.5, 1600, _GREY),
            Protocol("sa3d", "Jumpat/SegmentAnythingin3D, render.py of branch sa3d-gs, lib/evaluate.py and "
                     "configs/llff of main", ("alone",), 0.1, 1008, 0.0),
        ),
        "objects", expected=8,
    ),
    "lerf-mask": Layout(
        "LERF-Mask", find_lerf_mask, "masks '<scene>/test_mask/<view>/<words>.png'",
        (Protocol("gaussian-grouping", "lkeab/gaussian-grouping, script/eval_lerf_mask.py", ("in scene",),
                  size="camera", truth_above=_GREY),),
        second="boundary_iou", expected=23,
    ),
    "lerf-ovs": Layout(
        "LERF-OVS", find_lerf_ovs, "files 'label/<scene>/<picture>.json'",
        (Protocol("opengaussian", "yanmin-wu/OpenGaussian, scripts/compute_lerf_iou.py", ("alone",), _TENTH_OF_255,
                  truth_above=_TENTH_OF_255),),
        "scenes, by view", "acc25",
    ),
}  # fmt: skip
