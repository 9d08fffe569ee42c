"""What is to be seen after each action, and from where: the browser's picture of a scene, and the scene itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Annotated, Literal, get_args

import numpy as np

from gaussian_trimmer.app.snapshots import Similarity, Snapshot
from gaussian_trimmer.cameras import Camera, CameraSet, Point, Viewpoint, intrinsics, look_at, point_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import dominant_cluster
from gaussian_trimmer.output.report import checked_sides, middle_degree, why_unchecked
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting.select import views_to_click_in
from gaussian_trimmer.settings import Range
from gaussian_trimmer.surface.viewed_scene import small_view, surface_points
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.views.standing import stands_in_rooms

Place = tuple[float, float]
"""A place in the browser's picture, from (0, 0) at the upper left to (1, 1)."""

_MEDIAN_DISTANCE = 5.0
"""Median distance of the Gaussians from their middle, in the viewer's units."""
_FIRST_PICTURE, _FOV = (990, 720), np.radians(50)
"""Pixels of the picture for which a scene is framed, and the angle from its upper edge to its lower one."""
_FRAMED_SHARE, _RAISED_SHARE = 0.76, 0.03
"""Share of the picture's height, or width, that what is looked at fills, and by how much it is above the middle, as the
tools are below."""
_BEFORE_SURFACE = 0.999
"""Depth of a near plane that hides what stands before a surface, relative to the surface's."""


@dataclass(frozen=True, eq=False)
class Frame:
    """The viewer's coordinates: the scene's, moved and scaled, since float32 loses detail far from the origin."""

    centre: Float64Array
    """The viewer's origin in the scene, (3,)."""
    scale: float
    """The viewer's units in a unit of the scene."""

    @classmethod
    def around(cls, means: FloatArray) -> Frame:
        """Return the frame in which half of the centres (N, 3) lie within five units of the origin."""
        centre = np.median(means, axis=0).astype(np.float64)
        distance = float(np.median(np.linalg.norm(means - centre, axis=1)))
        return cls(centre, _MEDIAN_DISTANCE / distance if distance > 0 else 1.0)

    def to_viewer(self, points: Float64Array | FloatArray) -> Float64Array:
        """Return points of the scene (..., 3) in the viewer's coordinates."""
        return np.asarray((np.asarray(points, np.float64) - self.centre) * self.scale)

    def to_scene(self, points: Float64Array | Sequence[float]) -> Float64Array:
        """Return points in the viewer's coordinates (..., 3) in those of the scene."""
        return np.asarray(np.asarray(points, np.float64) / self.scale + self.centre)

    def moved(self, by: Similarity, *, to_scene: bool = False) -> Similarity:
        """Return what moves the viewer's points as another similarity moves those of the scene, or the other way."""
        turned = by.scale * by.rotation @ self.centre
        to = self.to_scene(by.to) - turned if to_scene else self.to_viewer(np.array(by.to) + turned)
        return replace(by, to=point_of(to))


@dataclass(frozen=True)
class View:
    """Where a tab looks from, in the viewer's coordinates."""

    eye: Point
    target: Point
    up: Point
    fov: Annotated[float, Range(0.01, 3.1)]
    """Angle from the picture's upper edge to its lower one."""
    width: Annotated[int, Range(1, 1 << 14)]
    height: Annotated[int, Range(1, 1 << 14)]
    near: Annotated[float, Range(1e-9, 1e9)] = 0.01


def viewpoint_of(view: View, frame: Frame) -> Viewpoint:
    """Return the view of the scene that a tab has, to which marks can refer.

    Raises:
        InputError: the eye looks nowhere.
    """
    try:
        pose = look_at(frame.to_scene(view.eye), frame.to_scene(view.target), np.array(view.up))
    except ValueError as error:
        raise InputError("The view looks nowhere; press Home.") from error
    focal = view.height / 2 / np.tan(view.fov / 2)
    K = np.array([[focal, 0, view.width / 2], [0, focal, view.height / 2], [0, 0, 1.0]])
    return Viewpoint(Camera(pose, K, view.width, view.height, near=view.near / frame.scale))


def first_look(scene: Gaussians, cameras: CameraSet | None, up: Float64Array) -> tuple[Point, Point]:
    """Return from where a scene is looked at first, and at which point.

    That is as its first camera does; without cameras, in rooms, as a person who stands where most things are seen, and
    otherwise from outside, so that all but strays is in the picture.
    """
    if cameras is None and (stands := stands_in_rooms(scene, up)):
        return point_of(stands[0][0]), point_of(stands[0][1])
    if cameras is None:
        width, height = _FIRST_PICTURE
        camera = views_to_click_in(scene, None, up)[0].camera
        K = intrinsics(2 * float(np.arctan(width / height * np.tan(_FOV / 2))), width, height)
        return framed(scene, replace(camera, K=K, width=width, height=height))
    camera = cameras.cameras[0]
    ahead = (scene.means - camera.centre) @ camera.forward
    depth = float(np.median(ahead[ahead > 0])) if (ahead > 0).any() else 1.0
    return point_of(camera.centre), point_of(camera.centre + depth * camera.forward)


def framed(gaussians: Gaussians, camera: Camera) -> tuple[Point, Point]:
    """Return from where Gaussians fill a camera's picture as it looks now, and at which point; strays do not count."""
    local = gaussians.means[dominant_cluster(gaussians)].astype(np.float64) @ camera.rotation.T
    sizes, focal = np.array([camera.width, camera.height]), np.diag(camera.K)[:2]
    half, raised = _FRAMED_SHARE * sizes / 2 / focal, np.array([0, _RAISED_SHARE]) * sizes / focal
    upper, lower = half + raised, half - raised
    # An eye at (x, y, -depth) has a point (px, py, pz) in its frame where -upper <= (p - eye) / (pz + depth) <= lower.
    low = (local[:, :2] + upper * local[:, 2:]).min(axis=0)
    high = (local[:, :2] - lower * local[:, 2:]).max(axis=0)
    middle = float(np.median(local[:, 2]))
    distance = max(float(((high - low) / (upper + lower)).max()) + middle, 1e-9)
    across = (high + low + (upper - lower) * (distance - middle)) / 2
    eye = camera.rotation.T @ np.array([*across, middle - distance])
    return point_of(eye), point_of(eye + distance * camera.forward)


def pixel_at(view: Viewpoint, place: Place) -> tuple[int, int]:
    """Return the pixel at a place of the picture, whose left upper corner is (0, 0) and right lower one (1, 1)."""
    sizes = (view.camera.width, view.camera.height)
    x, y = (min(max(int(share * size), 0), size - 1) for share, size in zip(place, sizes, strict=True))
    return x, y


def before_what_shows(gaussians: Gaussians, view: Viewpoint, places: Sequence[Place]) -> Viewpoint:
    """Return the view without what stands before some of the scene's Gaussians at places of the picture, as `pixel_at`.

    The near plane moves up to the first of these Gaussians, so that a mark meant for them, made while others are
    hidden, does not meet the others, whoever understands it.

    Raises:
        InputError: none of the Gaussians is seen at these places.
    """
    depths = view.camera.to_camera(points_at(gaussians, view, places))[:, 2]
    if np.isnan(depths).all():
        raise InputError("Nothing that is shown is there; click on what you see.")
    depth = float(np.nanmin(depths))
    return Viewpoint(replace(view.camera, near=max(view.camera.near, _BEFORE_SURFACE * depth)))


def points_at(gaussians: Gaussians, view: Viewpoint, places: Sequence[Place]) -> Float64Array:
    """Return the points that show at places of the picture, as `pixel_at`, (P, 3); NaN where nothing is seen."""
    small = small_view(view.camera)
    return surface_points(gaussians, small, np.array([pixel_at(Viewpoint(small), place) for place in places]))


_SOFT = (0.05, 0.5)
"""Alpha of pixels that are the object's and hardly show it."""
_RISE = 0.3
"""How high a side is looked at from, relative to the distance."""


def doubts(result: TrimResult) -> list[tuple[str, Float64Array]]:
    """Return what there is to doubt of a single object, in words, and the direction (3,) from the object to see it."""
    part = result.objects[0]
    found = [(view, view.view.camera.centre - part.bounds.centre) for view in part.views]
    said = [(f"From here it could not be checked: {view.rejected}.", away) for view, away in found if view.rejected]
    checked, observed = checked_sides(part, result.cameras)
    if why := why_unchecked(unseen := middle_degree(~checked), checked, observed):
        yaw = np.radians(unseen)
        away = np.array([np.cos(yaw), np.sin(yaw), _RISE]) @ part.bounds.axes
        said.append((f"The side seen least: {why}.", away))
    alphas = [render(part.gaussians, view.view.camera).alpha for view, _ in found]
    if alphas:
        soft = [((alpha > _SOFT[0]) & (alpha < _SOFT[1])).mean() for alpha in alphas]
        said.append(("The softest edge is seen from here.", found[int(np.argmax(soft))][1]))
    if why_open := result.rest.not_filled.get(part.id):
        said.append((f"The hole is not filled: {why_open}.", part.up.direction + _RISE * part.bounds.axes[0]))
    return said


Part = Literal["Everything", "Object", "Scene without it"]
When = Literal["Selection", "Cut-out"]
Colouring = Literal["Own", "Objects", "Changes"]
PARTS, WHENS, COLOURINGS = get_args(Part), get_args(When), get_args(Colouring)
"""As the page names them."""


@dataclass(frozen=True)
class Showing:
    """What is to be seen."""

    part: Part = "Everything"
    when: When = "Selection"
    """The selection, or the cut-out; an object that has not been cut out is shown as it is selected."""
    colours: Colouring = "Objects"
    """Those of the scene, the objects tinted, or what was changed tinted: by the trim, or else by the last marks."""
    ghost: bool = False
    """With the object, the rest is there, grey and seen through, and can be marked."""


class Event(Enum):
    """What has just been done."""

    OPENED = "a scene, a project or a selection was opened, or objects were found"
    MARKED = "the active object was marked"
    CUT_OUT = "the active object was cut out"
    TAKEN_OUT = "the active object was taken out of the scene"
    PART_CHOSEN = "another part is to be seen"
    STEPPED = "a step was undone or redone, the object cleared, or another one chosen"


def showing_after(event: Event, now: Snapshot, showing: Showing) -> Showing:
    """Return what is to be seen after an event; tints and changes stay until something else is asked for.

    Args:
        event: what has been done.
        now: the state after it.
        showing: what was seen before, or what has just been chosen.
    """
    selected, cut = now.object.n_selected > 0, now.object.result is not None
    match event:
        case Event.OPENED:
            return Showing()
        case Event.MARKED:
            corrected = showing.when == "Cut-out" and cut
            colours: Colouring = "Changes" if corrected or showing.part == "Object" else "Objects"
            return replace(showing, when="Cut-out" if corrected else "Selection", colours=colours)
        case Event.CUT_OUT:  # in its own colours: a tint would hide what is wrong at the edge
            return Showing("Object", "Cut-out", "Own")
        case Event.TAKEN_OUT:
            return Showing("Everything", "Cut-out", "Own")
        case Event.PART_CHOSEN:
            colours = "Objects" if showing.part == "Everything" else "Own"
            when: When = "Cut-out" if showing.part == "Scene without it" and cut else showing.when
            return replace(showing, when=when, colours=colours)
        case Event.STEPPED:
            if not selected:
                return showing if showing.part == "Everything" else Showing()
            return replace(showing, part="Everything") if showing.part == "Scene without it" and not cut else showing


def due_after(event: Event, now: Snapshot, showing: Showing, due: bool) -> bool:
    """Tell whether a correction is to be cut out after an event, when nobody wants anything else; no undoing does that.

    Args:
        event: what has been done.
        now: the state after it.
        showing: what is seen after it.
        due: whether that was so before it.
    """
    if event is Event.PART_CHOSEN:
        return due
    return event is Event.MARKED and now.object.stale and showing.when == "Cut-out"
