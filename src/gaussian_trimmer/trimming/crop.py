"""Which part of the scene is looked at for one object, and from where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.cameras import Camera, training_cameras
from gaussian_trimmer.config import CONTEXT_RADIUS
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.geometry.bounds import Bounds, touching
from gaussian_trimmer.planning.observed_angles import cameras_that_see
from gaussian_trimmer.planning.observed_side import limit_yaw_to_observed
from gaussian_trimmer.planning.virtual_cameras import plan_cameras
from gaussian_trimmer.scene_crop import SceneCrop
from gaussian_trimmer.trimming.setup import Setup

_MOST_STEPS = 8
"""Limit to the work: steps from Gaussian to touching Gaussian in which what is selected hangs together with the
object."""
_SEEN_DEVIATIONS = 3.0
"""Standard deviations from its centre up to which a Gaussian may show in a picture."""


def crop_scene(setup: Setup, selection: BoolArray, excluded: BoolArray, up: Float64Array) -> SceneCrop:
    """Plan the views of an object, and find the Gaussians around it.

    Args:
        setup: the scene, settings and cameras.
        selection: the selected object, (N,).
        excluded: which Gaussians may not join it unless they are selected, (N,).
        up: the up vector, (3,).
    """
    scene, config = setup.scene, setup.config
    known = training_cameras(setup.cameras)
    planned, bounds = plan_cameras(scene.select(selection), up, config.plan, known)
    rows, selected = _surroundings(scene, selection, bounds, config.context_radius)
    if setup.view_cameras:
        planned = list(setup.view_cameras)
    elif not cameras_that_see(known, bounds):
        plan = limit_yaw_to_observed(scene, selection, bounds, config.plan)
        if plan is not config.plan:
            planned, bounds = plan_cameras(scene.select(rows[selected]), up, plan)
    occluding = np.zeros(len(scene), np.bool_)
    if setup.view_cameras and config.context_radius > 0:
        occluding = _before(scene, setup.view_cameras, bounds)
        occluding[rows] = False
    return SceneCrop(scene, bounds, planned, rows, selected, (excluded & ~selection)[rows], scene.select(occluding))


def _surroundings(
    scene: Gaussians, selection: BoolArray, bounds: Bounds, context_radius: float
) -> tuple[IntArray, BoolArray]:
    """Scene rows of the object and of the Gaussians around it (eq. 7), and which of them are the object.

    Selected Gaussians far from the object that nothing connects with it, floaters, are neither; nor are those that are
    wider than what is looked at.
    """
    offset = scene.means - bounds.centre.astype(np.float32)
    squared = np.einsum("ni,ni->n", offset, offset)
    reach = max(context_radius, CONTEXT_RADIUS) * bounds.radius
    possible = selection & (scene.largest_log_scales < np.log(reach))
    members = possible & (squared < reach**2)
    members = _with_connected(scene, possible, members) if members.any() else selection
    rows = np.flatnonzero(members | (~selection & (squared < (context_radius * bounds.radius) ** 2)))
    return rows, members[rows]


def _before(scene: Gaussians, cameras: Sequence[Camera], bounds: Bounds) -> BoolArray:
    """Which Gaussians some camera may see nearer than the far end of the object, (N,)."""
    found, widths = np.zeros(len(scene), np.bool_), np.exp(scene.largest_log_scales)
    means = scene.means.astype(np.float64)
    for camera in cameras:
        pixels, depths = camera.project(means)
        far = float(camera.project(bounds.centre[None])[1][0]) + bounds.radius
        possible = np.flatnonzero((depths > camera.near) & (depths < far))
        x, y = pixels[possible].T
        aside = np.maximum(np.maximum(-x, x - camera.width), np.maximum(-y, y - camera.height))
        focal_length = max(camera.K[0, 0], camera.K[1, 1])
        reach = _SEEN_DEVIATIONS * widths[possible] * focal_length / depths[possible]
        found[possible[aside < reach]] = True
    return found


def _with_connected(scene: Gaussians, selection: BoolArray, members: BoolArray) -> BoolArray:
    """The members with those of the other selected Gaussians that hang together with it, (N,)."""
    rows = np.flatnonzero(selection)
    selected, member = scene.select(rows), members[rows]
    for _ in range(_MOST_STEPS):
        found = touching(selected, member) if not member.all() else np.zeros(0, np.bool_)
        if not found.any():
            break
        member = member | found
    return mask_of_rows(rows[member], len(scene))
