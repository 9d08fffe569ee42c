"""What callers may give to `trim`, brought into the one form that its stages take. N Gaussians."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.cameras import Camera, CameraSet, unit_up
from gaussian_trimmer.config import TrimConfig, check_config
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def check_scene(scene: Any, cameras: Any) -> None:
    """Refuse paths, bare arrays and lists where a scene and a set of cameras are needed.

    Raises:
        InputError: the scene is no `Gaussians`, or the cameras are neither a `CameraSet` nor None.
    """
    if not isinstance(scene, Gaussians):
        raise InputError(
            f"The scene is a {type(scene).__name__}; give Gaussians, from gaussian_trimmer.read(path) or "
            "Gaussians.from_arrays(...)."
        )
    if cameras is not None and not isinstance(cameras, CameraSet):
        raise InputError(
            f"The cameras are a {type(cameras).__name__}; give a CameraSet, from gaussian_trimmer.read_cameras(path), "
            "or use view_cameras for cameras to look from."
        )
    check_magnitudes(scene)


def mask_of_selection(selection: ArrayLike, n: int) -> BoolArray:
    """A selection as a mask of n Gaussians (N,), a new array.

    Booleans (N,) are taken as they are. N whole numbers that are all 0 or 1, or all 0 or 255, are a mask too. Any other
    whole numbers are row numbers, from 0, in any order, each once.

    Raises:
        InputError: the selection is none of these, is empty, or can be understood in both ways.
    """
    try:
        values = np.asarray(selection)
    except (TypeError, ValueError, RuntimeError) as error:  # ragged lists, arrays on a device
        raise InputError(
            f"The selection is a {type(selection).__name__} that NumPy cannot read ({error}); give a NumPy array."
        ) from error
    if values.ndim == 1 and not values.size:
        raise InputError("The selection is empty: no Gaussian of the scene belongs to the object.")
    if values.dtype == np.bool_ and values.shape == (n,):
        mask = values.copy()
    elif values.dtype.kind in "iu" and values.ndim == 1:
        mask = _mask_of_integers(values, n)
    else:
        scores = ", such as 'scores > 0.5'" if values.dtype.kind == "f" else ""
        raise InputError(
            f"The selection has shape {values.shape} and type {values.dtype}; {n} booleans are needed{scores}, or "
            f"{n} whole numbers that are 0 and 1 or 0 and 255, or row numbers."
        )
    if not mask.any():
        raise InputError("The selection is empty: no Gaussian of the scene belongs to the object.")
    return mask


def mask_of_excluded(selection: Any, excluded: Any, n: int) -> BoolArray:
    """Which of n Gaussians may not join the object (N,): those that are given, or that a selection's marks removed.

    Raises:
        InputError: they are no n booleans.
    """
    if excluded is None:
        excluded = getattr(selection, "excluded", None)
    if excluded is None:
        return np.zeros(n, np.bool_)
    mask = np.asarray(excluded)
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise InputError(
            f"What is excluded has shape {mask.shape} and type {mask.dtype}; {n} booleans are needed, one a Gaussian."
        )
    return mask


def _mask_of_integers(values: NDArray[Any], n: int) -> BoolArray:
    lowest, highest = int(values.min()), int(values.max())
    on = 255 if highest == 255 else 1
    may_be_mask = len(values) == n and bool(((values == 0) | (values == on)).all())
    may_be_rows = lowest >= 0 and highest < n and len(np.unique(values)) == len(values)
    if may_be_mask and may_be_rows:  # only scenes of one or two Gaussians
        raise InputError(
            f"The selection {values.tolist()} can be a mask of {n} Gaussians or a list of row numbers; give booleans."
        )
    if may_be_mask:
        return np.asarray(values != 0)
    if lowest < 0 or highest >= n:
        wrong = lowest if lowest < 0 else highest
        raise InputError(
            f"The selection names row {wrong}, but the scene's {n} Gaussians have the row numbers 0 to {n - 1}; a mask "
            f"has {n} values that are 0 and 1 or 0 and 255, and this selection has {len(values)} from {lowest} to "
            f"{highest}."
        )
    if not may_be_rows:
        raise InputError(
            f"The selection holds {len(values)} whole numbers from {lowest} to {highest}, some of them equal, for {n} "
            f"Gaussians: row numbers name each row once, a mask has {n} values that are 0 and 1 or 0 and 255, and "
            "labels become a mask by a comparison, such as 'labels == 3'."
        )
    mask = np.zeros(n, np.bool_)
    mask[values] = True
    return mask


def vector_of_up(up: Any) -> tuple[float, float, float]:
    """An up vector from the name of an axis, such as "z" or "-y", or from three numbers.

    Raises:
        InputError: no axis has that name, or it is not three finite numbers that are not all zero.

    >>> vector_of_up("z"), vector_of_up([0, -2, 0])
    ((0.0, 0.0, 1.0), (0.0, -2.0, 0.0))
    """
    if isinstance(up, str):
        sign, axis = (-1.0, up[1:]) if up.startswith("-") else (1.0, up.removeprefix("+"))
        if axis.lower() not in _AXES:
            raise InputError(f"The up vector is '{up}'; give x, y, z, -x, -y or -z, or three numbers.")
        up = [sign * value + 0.0 for value in _AXES[axis.lower()]]
    unit_up(up)
    x, y, z = (float(value) for value in up)
    return x, y, z


def settings(
    config: TrimConfig | None, views: int | None, up: Any, view_cameras: Sequence[Camera] | None
) -> TrimConfig:
    """The settings of a trim: those of the config, with the number of views and the up vector that were given.

    Raises:
        InputError: an argument is not of the kind that its name asks for, or two of them contradict each other.
    """
    config = TrimConfig() if config is None else config
    if not isinstance(config, TrimConfig):
        raise InputError(f"The config is a {type(config).__name__}; give a TrimConfig.")
    if view_cameras is not None:
        _check_view_cameras(view_cameras, views)
    if views is not None:
        config = replace(config, plan=replace(config.plan, views=_number_of_views(views)))
    config = config if up is None else replace(config, up=vector_of_up(up))
    check_config(config)
    return config


def _check_view_cameras(view_cameras: Any, views: Any) -> None:
    if isinstance(view_cameras, CameraSet):
        raise InputError("view_cameras is a CameraSet; give a list of its cameras, or give it as cameras.")
    if not isinstance(view_cameras, Sequence) or not all(isinstance(camera, Camera) for camera in view_cameras):
        raise InputError("view_cameras must be a list of cameras.Camera.")
    if not view_cameras:
        raise InputError("view_cameras is an empty list; leave it out for virtual cameras.")
    if views is not None:
        raise InputError(f"{views} virtual views cannot be had beside {len(view_cameras)} view_cameras; leave one out.")


def _number_of_views(views: Any) -> int:
    try:
        if not isinstance(views, (bool, np.bool_)):
            return operator.index(views)
    except TypeError:
        pass
    raise InputError(
        f"views is a {type(views).__name__}; it is the number of virtual views, and view_cameras is the list of "
        "cameras to look from instead."
    )
