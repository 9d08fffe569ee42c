"""The part of the scene that the views of one object show, and from where they look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
from gaussian_trimmer.config import CONTEXT_RADIUS, TrimConfig
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.bounds import Bounds, touching
from gaussian_trimmer.geometry.support_plane import SupportPlane, find_support_plane
from gaussian_trimmer.planning.coverage import limit_yaw_to_observed
from gaussian_trimmer.planning.observed_angles import cameras_that_see
from gaussian_trimmer.planning.up_vector import UpVector
from gaussian_trimmer.planning.virtual_cameras import plan_cameras

_MAX_WIDTH = 4.0
"""Largest standard deviation of a Gaussian of the object, in object radii."""
_CONNECTING_STEPS = 8
"""Steps from Gaussian to touching Gaussian in which what is selected hangs together with the object."""


@dataclass(frozen=True, eq=False)
class Scope:
    """The part of the scene that the views show, and the cameras of the views."""

    up: UpVector
    bounds: Bounds
    cameras: list[Camera]
    rows: IntArray
    """Scene rows of the object and of the Gaussians around it, ascending, (L,)."""
    local: Gaussians
    """Those Gaussians."""
    coarse: BoolArray
    """Which of them are selected, without floaters far from the object, (L,)."""
    excluded: BoolArray
    """Which of them may not become part of the object, (L,)."""


def plan_scope(
    scene: Gaussians, selection: BoolArray, excluded: BoolArray, up: UpVector, config: TrimConfig,
    cameras: CameraSet | None, views: Sequence[Camera] | None,
) -> Scope:  # fmt: skip
    """Cameras, and the object with the Gaussians around it."""
    known = training_cameras(cameras)
    planned, bounds = plan_cameras(scene.select(selection), up.direction, config.plan, known)
    rows, coarse = _surroundings(scene, selection, bounds, config.context_radius)
    local = scene.select(rows)
    if views:
        planned = list(views)
    elif not cameras_that_see(known, bounds):
        plan = limit_yaw_to_observed(scene, selection, bounds, config.plan)
        if plan is not config.plan:
            planned, bounds = plan_cameras(local.select(coarse), up.direction, plan)
    return Scope(up, bounds, planned, rows, local, coarse, excluded[rows])


def _surroundings(
    scene: Gaussians, selection: BoolArray, bounds: Bounds, context_radius: float
) -> tuple[IntArray, BoolArray]:
    """Scene rows of the object and of the Gaussians around it (eq. 7), and which of them are the object.

    Selected Gaussians far from the object that nothing connects with it, floaters, are neither; nor are those that are
    several times as wide as the whole object.
    """
    offset = scene.means - bounds.centre.astype(np.float32)
    squared = np.einsum("ni,ni->n", offset, offset)
    possible = selection & (scene.log_scales.max(axis=1) < np.log(_MAX_WIDTH * bounds.radius))
    coarse = possible & (squared < (max(context_radius, CONTEXT_RADIUS) * bounds.radius) ** 2)
    coarse = _with_connected(scene, possible, coarse) if coarse.any() else selection
    rows = np.flatnonzero(coarse | (~selection & (squared < (context_radius * bounds.radius) ** 2)))
    return rows, coarse[rows]


def _with_connected(scene: Gaussians, selection: BoolArray, coarse: BoolArray) -> BoolArray:
    """The coarse object with those of the other selected Gaussians that hang together with it, (N,)."""
    rows = np.flatnonzero(selection)
    selected, member = scene.select(rows), coarse[rows]
    for _ in range(_CONNECTING_STEPS):
        found = touching(selected, member) if not member.all() else np.zeros(0, np.bool_)
        if not found.any():
            break
        member = member | found
    connected = np.zeros(len(scene), np.bool_)
    connected[rows[member]] = True
    return connected


def support_plane_of(scope: Scope, keep: BoolArray, seen: FloatArray, config: TrimConfig) -> SupportPlane | None:
    """The plane that the object stands on, if there is one."""
    positions = scope.local.means / np.float32(scope.bounds.radius)
    return find_support_plane(positions, keep, seen.astype(np.float64), scope.bounds, config.label_crf.support_plane)
