"""What callers may give to `trim`, brought into the one form that its stages take. N Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.cameras import Camera, CameraSet, vector_of_up
from gaussian_trimmer.config import TrimConfig, check_config
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.limits import check_magnitudes


def check_scene(scene: Any, cameras: Any) -> None:
    """Refuse paths, bare arrays and lists where a scene and a set of cameras are needed.

    Raises:
        InputError: the scene is not `Gaussians`, or holds numbers with which nothing can be computed; or the cameras
            are neither a `CameraSet` nor None.
    """
    if not isinstance(scene, Gaussians):
        raise InputError(f"The scene is a {type(scene).__name__}; give Gaussians, from gaussian_trimmer.read(path).")
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
        raise InputError(f"The selection is a {type(selection).__name__} that NumPy cannot read ({error}).") from error
    if values.dtype == np.bool_ and values.shape == (n,):
        mask = values.copy()
    elif values.dtype.kind in "iu" and values.ndim == 1 and values.size:
        mask = _mask_of_integers(values, n)
    elif values.size:
        raise InputError(
            f"The selection has shape {values.shape} and type {values.dtype}; {n} booleans are needed (such as "
            f"'scores > 0.5'), {n} whole numbers that are 0 and 1 or 0 and 255, or row numbers."
        )
    if not values.size or not mask.any():
        raise InputError("The selection is empty: no Gaussian of the scene belongs to the object.")
    return mask


def _mask_of_integers(values: NDArray[Any], n: int) -> BoolArray:
    lowest, highest = int(values.min()), int(values.max())
    is_mask = len(values) == n and bool(np.isin(values, (0, 255 if highest == 255 else 1)).all())
    are_rows = lowest >= 0 and highest < n and len(np.unique(values)) == len(values)
    if is_mask == are_rows:
        raise InputError(
            f"The selection has {len(values)} whole numbers from {lowest} to {highest}, which can be "
            f"{'both a mask and' if is_mask else 'neither a mask nor'} row numbers: a mask of {n} Gaussians has {n} "
            f"numbers that are 0 and 1 or 0 and 255, row numbers are from 0 to {n - 1}, each once. Give booleans, "
            "such as 'labels == 3'."
        )
    return np.asarray(values != 0) if is_mask else np.isin(np.arange(n), values)


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


def mask_of_excluded(selection: Any, excluded: Any, n: int) -> BoolArray:
    """Which of n Gaussians may not join the object (N,): those that are given, or that a selection's marks removed.

    Raises:
        InputError: they are not n booleans.
    """
    if excluded is None:
        excluded = getattr(selection, "excluded", None)
    mask = np.zeros(n, np.bool_) if excluded is None else np.asarray(excluded)
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise InputError(f"What is excluded has shape {mask.shape} and type {mask.dtype}; {n} booleans are needed.")
    return mask


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
        is_list = isinstance(view_cameras, Sequence) and len(view_cameras) > 0
        if not is_list or not all(isinstance(camera, Camera) for camera in view_cameras):
            raise InputError("view_cameras must be a list of cameras.Camera; leave it out for virtual cameras.")
        if views is not None:
            raise InputError(f"{views} views cannot be had beside {len(view_cameras)} view_cameras; leave one out.")
    if views is not None:
        config = replace(config, plan=replace(config.plan, views=views))
    if up is not None:
        config = replace(config, up=vector_of_up(up))
    check_config(config)
    return config
