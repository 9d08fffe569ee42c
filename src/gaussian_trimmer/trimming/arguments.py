"""What callers may give to `trim`, brought into the one form that its stages take. N Gaussians."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.cameras import Camera, CameraSet, as_camera_set, vector_of_up
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, check_gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.settings import check_settings
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.fringe import without_black_fringe
from gaussian_trimmer.trimming.up_vector import UpVector
from gaussian_trimmer.views.view import ViewMasks


@dataclass(frozen=True, eq=False)
class StrokeCut:
    """A stroke in a view. N Gaussians of the scene."""

    camera: Camera
    mask: BoolArray
    """Pixels under the stroke, (H, W)."""
    spared: BoolArray
    """What was selected again after it, (N,)."""
    taken: BoolArray
    """What it takes away whole, (N,): what that hides is not under the stroke."""


@dataclass(frozen=True, eq=False)
class Settled:
    """What strokes on a cut-out have settled. N Gaussians of the scene."""

    touched: BoolArray
    """Those that stay where the strokes put them, (N,)."""
    before: BoolArray
    """What was selected before the strokes, (N,): the trim decides about all others as if nothing else were."""
    excluded: BoolArray
    """What marks had removed before them, (N,)."""


@dataclass(frozen=True, eq=False)
class RoughObject:
    """An object as it was selected."""

    id: int
    name: str
    """What it was called; its id as text if it had no name."""
    rows: IntArray
    """Scene rows that were selected, ascending."""
    excluded: BoolArray | None = None
    """Gaussians of the scene that marks removed from it, (N,); None: none."""
    cuts: tuple[StrokeCut, ...] = ()
    """Strokes at which it is cut."""
    marked_from: tuple[Camera, ...] = ()
    """Cameras of the views in which it was marked, if that is known."""
    settled: Settled | None = None
    """What strokes on its cut-out have settled; None: nothing."""

    @property
    def undecided(self) -> RoughObject:
        """The object without the strokes on its cut-out, about which a trim decides."""
        if self.settled is None:
            return self
        return replace(self, rows=np.flatnonzero(self.settled.before), excluded=self.settled.excluded, settled=None)

    @property
    def touched(self) -> IntArray:
        """Scene rows, ascending, that strokes on its cut-out have settled."""
        return np.flatnonzero(self.settled.touched) if self.settled else np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class Setup:
    """A scene of N Gaussians, and how its objects are trimmed."""

    scene: Gaussians
    config: TrimConfig
    masks: ViewMasks | None = None
    """Masks of the object, if there is but one; None: the silhouettes of the corrected labels."""
    cameras: CameraSet | None = None
    """The cameras that the scene was trained with."""
    view_cameras: Sequence[Camera] | None = None
    """Cameras to look from in place of virtual ones."""
    excluded: BoolArray | None = None
    """Which Gaussians join no object unless they are selected, (N,); None: all may."""
    up: UpVector | None = None
    """The up vector of all objects; None if each must find the plane that it stands on."""
    up_warning: str | None = None
    """What speaks against it."""


def set_up(
    scene: Gaussians,
    objects: Any,
    config: TrimConfig | None,
    masks: Any,
    cameras: CameraSet | Sequence[Camera] | None,
    views: int | None,
    view_cameras: Sequence[Camera] | None,
    up: Any,
    excluded: Any,
) -> tuple[Setup, list[RoughObject]]:
    """Check what callers give, and bring it into one form."""
    check_gaussians(scene)
    check_magnitudes(scene)
    rough = visible_objects(rough_objects(objects, len(scene)), scene)
    unusable = np.count_nonzero(scene.blank)
    if len(rough) == 1 and len(rough[0].undecided.rows) + unusable == len(scene):  # it was captured alone
        scene = without_black_fringe(scene)
        rough = visible_objects(rough, scene)
    if masks is not None and len(rough) > 1:
        raise InputError(f"Masks are of one object, and {len(rough)} are to be trimmed; trim them one by one.")
    checked = checked_masks(masks)
    if checked and view_cameras and not same_cameras([camera for camera, _ in checked], view_cameras):
        raise InputError("Masks come with the cameras to look from; leave view_cameras out.")
    setup = Setup(
        scene=scene,
        config=settings(config, views, up, view_cameras),
        masks=checked,
        cameras=as_camera_set(cameras),
        view_cameras=view_cameras,
        excluded=mask_of_excluded(excluded, len(scene)),
        up=up if isinstance(up, UpVector) else None,
    )
    return setup, rough


def rows_of_selection(selection: ArrayLike, n: int) -> IntArray:
    """Return the rows, ascending, that a selection of n Gaussians means.

    Booleans (N,) are taken as they are. N whole numbers that are all 0 or 1, or all 0 or 255, are a mask too. Any other
    whole numbers are row numbers, from 0, in any order, each once.

    Raises:
        InputError: the selection is none of these, is empty, or can be understood in both ways.
    """
    if isinstance(selection, str | Path):
        raise InputError(
            f"The selection is a {type(selection).__name__}; give booleans or row numbers, such as those of "
            "gaussian_trimmer.read_selection(path, scene)."
        )
    try:
        values = np.asarray(selection)
    except (TypeError, ValueError, RuntimeError) as error:  # ragged lists, arrays on a device
        raise InputError(f"The selection is a {type(selection).__name__} that NumPy cannot read ({error}).") from error
    if values.dtype == np.bool_ and values.shape == (n,):
        rows = np.flatnonzero(values)
    elif values.dtype.kind in "iu" and values.ndim == 1 and values.size:
        rows = _rows_of_integers(values, n)
    elif values.size:
        raise InputError(
            f"The selection has shape {values.shape} and type {values.dtype}; {n} booleans are needed (such as "
            f"'scores > 0.5'), {n} whole numbers that are 0 and 1 or 0 and 255, or row numbers."
        )
    if not values.size or not len(rows):
        raise InputError("The selection is empty: no Gaussian of the scene belongs to the object.")
    return rows


def _rows_of_integers(values: NDArray[Any], n: int) -> IntArray:
    lowest, highest = int(values.min()), int(values.max())
    is_mask = len(values) == n and bool(np.isin(values, (0, 255 if highest == 255 else 1)).all())
    rows, times = np.unique(values, return_counts=True)
    are_rows = lowest >= 0 and highest < n and len(rows) == len(values)
    twice = f" (row {rows[times.argmax()]} is there {times.max()} times)" if len(rows) < len(values) else ""
    if is_mask == are_rows:
        raise InputError(
            f"The selection has {len(values)} whole numbers from {lowest} to {highest}, which can be "
            f"{'both a mask and' if is_mask else 'neither a mask nor'} row numbers: a mask of {n} Gaussians has {n} "
            f"numbers that are 0 and 1 or 0 and 255, row numbers are from 0 to {n - 1}, each once{twice}. Give "
            "booleans, such as 'labels == 3'."
        )
    return np.flatnonzero(values) if is_mask else rows.astype(np.int64)


def refuse_whole_scene(selection: BoolArray, path: Path | str, scene: Path | str) -> None:
    """Refuse the selection of a file that holds all Gaussians of a scene's.

    Raises:
        InputError: it does.
    """
    if selection.all():
        raise InputError(
            f"'{path}' selects all {len(selection)} Gaussians of '{scene}'; give the whole scene, or leave the "
            "selection out if the file holds the object alone."
        )


def rough_objects(objects: Any, n: int) -> list[RoughObject]:
    """Return the objects that callers give as selections of n Gaussians by id or name, as a list, or as labels (N,).

    Their ids are the keys where all of these are whole numbers above 0, or else count from 1; keys are their names.

    Raises:
        InputError: there is no object, or a selection that cannot be used.
    """
    if isinstance(objects, np.ndarray):
        return _objects_of_labels(objects, n)
    if not isinstance(objects, Mapping | Sequence) or isinstance(objects, str):
        raise InputError(
            f"The objects are a {type(objects).__name__}; give selections by id or name, such as {{1: mask}} or "
            "found.selections(), or a list of selections."
        )
    if not len(objects):
        raise InputError("There is no object to trim; give at least one id with its selection.")
    if not isinstance(objects, Mapping):
        objects = dict(enumerate(objects, 1))
    numbered = all(isinstance(key, Integral) and not isinstance(key, bool) and int(key) > 0 for key in objects)
    return [
        RoughObject(
            int(key) if numbered else place,
            str(key),
            rows_of_selection(selection, n),
            mask_of_excluded(getattr(selection, "excluded", None), n),
            getattr(selection, "cuts", ()),
            getattr(selection, "marked_from", ()),
            getattr(selection, "settled", None),
        )
        for place, (key, selection) in enumerate(objects.items(), 1)
    ]


def visible_objects(objects: Sequence[RoughObject], scene: Gaussians) -> list[RoughObject]:
    """Return the objects without the rows of the scene that reading has found to be unusable.

    Raises:
        InputError: an object has no others.
    """
    usable = ~scene.blank
    objects = [
        replace(
            part,
            rows=part.rows[usable[part.rows]],
            settled=part.settled and replace(part.settled, before=part.settled.before & usable),
        )
        for part in objects
    ]
    if empty := [part.name for part in objects if not len(part.rows)]:
        raise InputError(f"What is selected of {empty[0]} has opacities of exactly zero, so nothing of it can be seen.")
    return list(objects)


def _objects_of_labels(labels: NDArray[Any], n: int) -> list[RoughObject]:
    if labels.shape != (n,) or labels.dtype.kind not in "iu":
        raise InputError(
            f"The objects are an array of {labels.dtype} {labels.shape}; give the id of each of the {n} Gaussians' "
            "object as integers, 0 for none, or several selections as {1: mask, 2: other_mask}."
        )
    rows = np.flatnonzero(labels > 0)
    if not len(rows):
        raise InputError("The labels name no object: none is above 0.")
    rows = rows[np.argsort(labels[rows], kind="stable")]
    ids, starts = np.unique(labels[rows], return_index=True)
    return [RoughObject(int(i), str(i), part) for i, part in zip(ids, np.split(rows, starts[1:]), strict=True)]


def mask_of_excluded(excluded: Any, n: int) -> BoolArray | None:
    """Return which of n Gaussians join no object unless they are selected, (N,); None if there are none.

    Raises:
        InputError: they are not n booleans.
    """
    if excluded is None:
        return None
    mask = np.asarray(excluded)
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise InputError(f"What is excluded has shape {mask.shape} and type {mask.dtype}; {n} booleans are needed.")
    return mask


def settings(
    config: TrimConfig | None, views: int | None, up: Any, view_cameras: Sequence[Camera] | None
) -> TrimConfig:
    """Return the settings of a trim: those of the config, with the number of views and the up vector that were given.

    Raises:
        InputError: an argument is not of the kind that its name asks for, or two of them contradict each other.
    """
    config = TrimConfig() if config is None else config
    if not isinstance(config, TrimConfig):
        raise InputError(f"The config is a {type(config).__name__}; give TrimConfig.of({{'plan.views': 7}}).")
    if view_cameras is not None:
        is_list = isinstance(view_cameras, Sequence) and len(view_cameras) > 0
        if not is_list or not all(isinstance(camera, Camera) for camera in view_cameras):
            raise InputError(
                "view_cameras must be a list of gaussian_trimmer.cameras.Camera; leave it out for virtual cameras."
            )
        if views is not None:
            raise InputError(f"{views} views cannot be had beside {len(view_cameras)} view_cameras; leave one out.")
    if views is not None:
        config = replace(config, plan=replace(config.plan, views=views))
    if up is not None and not isinstance(up, UpVector):
        config = replace(config, up=vector_of_up(up))
    check_settings(config)
    return config


def checked_masks(masks: Any) -> ViewMasks | None:
    """Return masks of one object as booleans, each with its camera; None if there are none.

    Raises:
        InputError: they are not pairs of a camera and a mask of its size, of booleans or of floats.
    """
    if masks is None:
        return None
    try:
        pairs = [(camera, np.asarray(mask)) for camera, mask in masks]
    except (TypeError, ValueError, RuntimeError) as error:  # not pairs, ragged, or on a device
        raise InputError(f"Masks are pairs of a camera and its mask, in a list ({error}).") from error
    if not pairs or not all(isinstance(camera, Camera) for camera, _ in pairs):
        raise InputError("Masks are pairs of a gaussian_trimmer.cameras.Camera and its mask; give at least one.")
    for number, (camera, mask) in enumerate(pairs):
        if mask.shape != (camera.height, camera.width) or mask.dtype.kind not in "bf":
            raise InputError(
                f"Mask {number} has the shape {mask.shape} and type {mask.dtype}; booleans (such as 'mask > 127') are "
                f"needed, or floats above zero on the object, of the camera's {camera.height} rows of {camera.width}."
            )
    return [(camera, mask if mask.dtype == np.bool_ else np.asarray(mask > 0)) for camera, mask in pairs]


def same_cameras(first: Sequence[Camera], second: Sequence[Camera]) -> bool:
    """Return whether two lists hold the same cameras in the same order."""
    return len(first) == len(second) and all(
        a.width == b.width
        and a.height == b.height
        and np.array_equal(a.world_to_camera, b.world_to_camera)
        and np.array_equal(a.K, b.K)
        for a, b in zip(first, second, strict=True)
    )
