"""The part of the scene that is looked at for one object: what is in it, from where it is seen, and what is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gaussian_trimmer.cameras import Camera, training_cameras
from gaussian_trimmer.gaussians import (
    BoolArray,
    Float64Array,
    FloatArray,
    Gaussians,
    IntArray,
    concatenate,
    mask_of_rows,
)
from gaussian_trimmer.geometry.bounds import Bounds, touching
from gaussian_trimmer.rendering.tile_renderer import Drawing, draw, draw_projected
from gaussian_trimmer.trimming.arguments import Setup, same_cameras
from gaussian_trimmer.trimming.config import CONTEXT_RADIUS
from gaussian_trimmer.views.by_sight import ChosenViews, place_cameras
from gaussian_trimmer.views.view import HALF, View, bounding_box, clearly_nearer, shown_by
from gaussian_trimmer.views.virtual_cameras import framed_bounds

_MOST_STEPS = 8
"""Limit to the work: steps from Gaussian to touching Gaussian in which what is selected hangs together with the
object."""


@dataclass(frozen=True, eq=False)
class SceneCrop:
    """L Gaussians of a scene, and the cameras of the views that show them."""

    scene: Gaussians
    """All N Gaussians."""
    bounds: Bounds
    """Bounds of the selected object; their third axis is up."""
    cameras: Sequence[Camera]
    rows: IntArray
    """Scene rows of the Gaussians, ascending, (L,)."""
    selected: BoolArray
    """Which of them are selected, without floaters far from the object, (L,)."""
    excluded: BoolArray
    """Which of them may not become part of the object, (L,)."""
    occluders: Gaussians
    """What else the cameras see before the object, unless they were planned: pictures and masks show that, too."""
    pictured: bool
    """Whether there are masks of pictures from the cameras, which show more than the scene does."""
    chosen: ChosenViews | None = None
    """Where the cameras were chosen by what they show, the directions, the best first."""

    @cached_property
    def local(self) -> Gaussians:
        """The L Gaussians themselves."""
        return self.scene.select(self.rows)

    @cached_property
    def shown(self) -> Gaussians:
        """What the views show: the L Gaussians, and the occluders after them."""
        return concatenate([self.local, self.occluders]) if len(self.occluders) else self.local

    def without_copies(self) -> SceneCrop:
        """Return the same crop, which copies `local` and `shown` from the scene again when they are asked for."""
        return replace(self)


def crop_scene(
    setup: Setup, selection: BoolArray, excluded: BoolArray, up: Float64Array, marked_from: Sequence[Camera] = ()
) -> SceneCrop:
    """Plan the views of an object, and find the Gaussians around it.

    Args:
        setup: the scene, settings and cameras.
        selection: the selected object, (N,).
        excluded: which Gaussians may not join it unless they are selected, (N,).
        up: the up vector, (3,).
        marked_from: cameras of the views in which the object was marked.
    """
    scene, config = setup.scene, setup.config
    target = scene.select(selection)
    bounds = framed_bounds(target, up, config.plan)
    rows, selected = _surroundings(scene, selection, bounds, config.context_radius)
    cameras, chosen = list(setup.view_cameras or ()), None
    if not cameras:
        training, count = training_cameras(setup.cameras), max(config.plan.views, config.refinement.views)
        cameras, chosen = place_cameras(
            scene, target, rows[selected], bounds, config.plan, count, training, marked_from
        )
    masked = [camera for camera, _ in setup.masks or ()]
    pictured = bool(masked) and not same_cameras(masked, cameras)
    if pictured:
        cameras, chosen = masked, None
    occluding = np.zeros(len(scene), np.bool_)
    if (pictured or setup.view_cameras) and config.context_radius > 0:
        occluding = shown_by(scene, cameras, bounds)
        occluding[rows] = False
    return SceneCrop(
        scene,
        chosen.bounds if chosen else bounds,
        cameras,
        rows,
        selected,
        (excluded & ~selection)[rows],
        scene.select(occluding),
        pictured,
        chosen,
    )


def draw_views(crop: SceneCrop) -> tuple[Drawing, Drawing]:
    """Return what the cameras of a crop see, and the selected object alone without colours, with blend weights."""
    whole = [np.ones((1, camera.height, camera.width), np.float32) for camera in crop.cameras]
    pictures = draw(crop.shown, crop.cameras, images=whole)
    alone = pictures.projection.of(np.append(crop.selected, np.zeros(len(crop.occluders), np.bool_)))
    return pictures, draw_projected(crop.shown, alone, images=whole, colours=False)


def complete_views(crop: SceneCrop, pictures: Drawing, objects: Drawing, probability: FloatArray) -> list[View]:
    """Return what each camera of a crop sees of the object and around it.

    Args:
        crop: the object and the Gaussians around it, L of them.
        pictures: what its cameras see.
        objects: the selected object alone.
        probability: the corrected labels, (L,).
    """
    shares = np.zeros((len(crop.shown), 2), np.float32)
    shares[: len(probability)] = np.stack([crop.selected, probability], axis=1)
    views, pixels = [], pictures.blend(shares, np.max(shares, axis=1) > HALF)
    shown = zip(crop.cameras, pictures.renderings(), objects.alpha, objects.depth, pixels, strict=True)
    for camera, picture, alpha, depth, (visible, expected) in shown:
        whole = alpha > HALF
        hidden = whole & (visible <= HALF) & clearly_nearer(picture.depth, depth, crop.bounds.radius)
        views.append(View(camera, picture, alpha, visible, expected, bounding_box(whole), hidden))
    return views


def _surroundings(
    scene: Gaussians, selection: BoolArray, bounds: Bounds, context_radius: float
) -> tuple[IntArray, BoolArray]:
    """Return scene rows of the object and of the Gaussians around it (eq. 7), and which of them are the object.

    Selected Gaussians far from the object that nothing connects with it, floaters, are neither; nor are those that are
    wider than what is looked at.
    """
    reach = max(context_radius, CONTEXT_RADIUS) * bounds.radius
    squared = bounds.squared_distances(scene.means)
    possible = selection & (scene.largest_log_scales < np.log(reach))
    members = possible & (squared < reach**2)
    members = _with_connected(scene, possible, members) if members.any() else selection
    rows = np.flatnonzero(members | (~selection & (squared < (context_radius * bounds.radius) ** 2)))
    return rows, members[rows]


def _with_connected(scene: Gaussians, selection: BoolArray, members: BoolArray) -> BoolArray:
    """Return the members with those of the other selected Gaussians that hang together with it, (N,)."""
    rows = np.flatnonzero(selection)
    selected, member = scene.select(rows), members[rows]
    for _ in range(_MOST_STEPS):
        found = touching(selected, member) if not member.all() else np.zeros(0, np.bool_)
        if not found.any():
            break
        member = member | found
    return mask_of_rows(rows[member], len(scene))
