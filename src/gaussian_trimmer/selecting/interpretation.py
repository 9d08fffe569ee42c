"""What marks mean: each adds to what those before it selected, removes from it, or keeps its share of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet, Point, Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.find import ThingsAtPoints
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.geometry.copies import distinct_gaussians
from gaussian_trimmer.selecting.clicks import (
    pieces_at_click,
    seen_alone,
    select_around_click,
    select_by_box,
    select_by_click,
    select_by_colour,
)
from gaussian_trimmer.selecting.graph_cuts import correct_at_click, expected_radius, is_meant_whole, nearest_to
from gaussian_trimmer.selecting.lifting import lift_folder
from gaussian_trimmer.selecting.marks import (
    Box,
    Box3D,
    Click,
    Effect,
    FromFile,
    FromMasks,
    Grow,
    Mark,
    Marks,
    Rows,
    Shrink,
    Sphere,
    View,
)
from gaussian_trimmer.selecting.selection import Seed, Selection
from gaussian_trimmer.selecting.shapes import drawn_over, grown, inside_shape, shrunk
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.surface.overview import drawn_part
from gaussian_trimmer.surface.viewed_scene import Target, ViewedScene, look_at_pixel
from gaussian_trimmer.trimming.arguments import Settled, StrokeCut
from gaussian_trimmer.views.view import HALF

_BOX_TAKES_ALL = 0.9
"""A box that would remove more than this share of the selection means only what is selected within its sides."""
INTERPRETATIONS = {
    "piece": "an object that stands on a surface",
    "alone": "all that is seen there, with nothing beside it",
    "part": "the part in the box, its back included",
    "around": "the region around the click, as nothing there stands on a surface; a --box around it may do better",
    "colour": "what goes on from there in a colour like it",
    "size": "the next larger or smaller thing there, as the click was made again",
    "region": "the boundary moved around the click",
    "frame": "all that is selected in the box",
}
"""How marks in views are understood."""


class MarkInterpreter:
    """Understands marks one at a time: what `select` does for a whole list, without beginning anew at each mark."""

    def __init__(self, scene: Gaussians, marks: Marks, cameras: CameraSet | None = None) -> None:
        """Take the up vector, and the places of the photographs, from a list of resolved marks.

        Args:
            scene: all N Gaussians.
            marks: resolved marks; which ones they are does not matter here.
            cameras: the cameras of the pictures that masks belong to.
        """
        self._whole, self._distinct = scene, distinct_gaussians(scene)
        self._scene, self._up, self._cameras = self._distinct.gaussians, np.array(marks.up), cameras
        self._seen_from = tuple(_camera_at(place) for place in marks.photographed_from)
        self._things = ThingsAtPoints(self._scene, self._up)

    def apply(self, before: Selection, mark: Mark) -> Selection:
        """Return the selection after one more mark, whose view is resolved; nothing may remain selected.

        Raises:
            InputError: the mark is not possible, or nothing is seen at its pixels.
        """
        number = len(before.interpretations) + 1
        if not isinstance(mark, Mark):
            raise InputError(
                f"Mark {number} is a {type(mark).__name__}; give gaussian_trimmer.marks.Click(...) or another of its "
                "marks."
            )
        if not before.mask.any() and getattr(mark, "effect", "remove") != "add":
            raise InputError(
                f"Mark {number} changes a selection, but nothing is selected before it; begin with others."
            )
        if not (isinstance(mark, Rows) and mark.settled):
            before = replace(before, settled=None)
        after, interpretation = self._applied(before, mark, number)
        if not isinstance(mark, Click):
            after = replace(after, other_sizes=(), before_click=None)
        return replace(after, interpretations=(*before.interpretations, interpretation))

    def _applied(self, state: Selection, mark: Mark, number: int) -> tuple[Selection, str]:
        means = self._whole.means
        match mark:
            case Click() | Box() | Grow() | Shrink():
                after, how = self._applied_among(state.among(self._distinct.rows), mark)
                return state.changed_by(after, self._distinct), how
            case Box3D() | Sphere():
                name = "a 3D box" if isinstance(mark, Box3D) else "a sphere"
                return state.combined(inside_shape(means, mark, self._up), mark.effect), name
            case Rows():
                found = mark.mask(len(means))
                combined = state.combined(found, mark.effect)
                if mark.settled:
                    was = state.settled or Settled(np.zeros_like(found), state.mask, state.excluded_mask)
                    touched = was.touched | (~found if mark.effect == "intersect" else found)
                    combined = replace(combined, settled=replace(was, touched=touched))
                if mark.cut is not None:
                    cut = StrokeCut(*drawn_over(mark.cut), np.zeros_like(found), found)
                    combined = replace(combined, cuts=(*combined.cuts, cut))
                return combined, mark.tool
            case FromFile():
                if identify(mark.path).kind == "marks":
                    raise InputError(f"'{mark.path}' holds marks; give the .npy beside it, which they selected.")
                notes = [f"'{mark.path.name}'"]
                found = load_selection(mark.path, self._whole, mark.options, notes.append)
                return state.combined(found, mark.effect), "; ".join(notes)
            case FromMasks():
                found, n = lift_folder(self._whole, self._cameras, mark.folder, mark.gamma)
                return state.combined(found, mark.effect), f"{n} masks"

    def _applied_among(self, state: Selection, mark: Click | Box | Grow | Shrink) -> tuple[Selection, str]:
        """Apply a mark for which copies count as one to a selection of distinct Gaussians."""
        means = self._scene.means
        match mark:
            case Click():
                return self._click(state, mark)
            case Box():
                return self._box(state, mark)
            case Grow():
                return state.combined(grown(means, state.mask, mark.spacings), "add"), "grown"
            case Shrink():
                return replace(state, mask=shrunk(means, state.mask, mark.spacings)), "shrunk"

    def _click(self, state: Selection, mark: Click) -> tuple[Selection, str]:
        view, rows = self._viewed(mark.view)
        before, state = state, replace(state, other_sizes=(), before_click=None)
        target = look_at_pixel(view, mark.x, mark.y)
        after, how = self._understood(before, state, mark, view, rows, target)
        if len(after.seeds) == len(state.seeds):
            after = replace(after, seeds=(*state.seeds, Seed(target.point, 0.0, mark.effect != "remove")))
        return after, how

    def _understood(
        self, before: Selection, state: Selection, mark: Click, view: ViewedScene, rows: IntArray, target: Target
    ) -> tuple[Selection, str]:
        """Return what a click in a view of some rows of the scene selects, and how it was understood.

        Args:
            before: what was selected before the click.
            state: the same, without other sizes.
            mark: the click.
            view: what is drawn.
            rows: of the scene, of what is drawn.
            target: the point, and what shows there.
        """
        if mark.tolerance:
            return _combined(state, select_by_colour(view, mark.x, mark.y, mark.tolerance), rows, mark.effect, "colour")
        first = not state.mask.any() or mark.effect == "intersect"
        if not self._things.needed:
            return self._first_click(state, view, rows, mark) if first else _correction(state, view, rows, mark, target)
        found = self._thing_at(before, state, target, rows, mark.effect, first)
        if found is None:
            return _near(state, view, rows, mark, target) if first else _correction(state, view, rows, mark, target)
        return found

    def _thing_at(
        self, before: Selection, state: Selection, target: Target, rows: IntArray, effect: Effect, first: bool
    ) -> tuple[Selection, str] | None:
        """Select the thing that the finder sees at a point of a large capture, or its next size; None without one.

        Args:
            before: what was selected before the click.
            state: the same, without other sizes.
            target: the point, and what shows there.
            rows: of the scene, of what is drawn.
            effect: of the click.
            first: nothing of the thing is selected yet.
        """
        seen = np.zeros(len(state.mask), np.float32)
        seen[rows] = target.seeds
        if before.other_sizes and effect == "add" and 2 * seen[state.mask].sum() > seen.sum():
            assert before.before_click is not None, "it has other sizes"
            return _sized(before.before_click, before.other_sizes, effect), INTERPRETATIONS["size"]
        things = self._things.at(target.point, seen)
        if things and (first or is_meant_whole(mask_of_rows(things[0], len(seen)), state.mask, effect)):
            return _sized(state, things, effect), INTERPRETATIONS["piece"]
        return None

    def _first_click(self, state: Selection, view: ViewedScene, rows: IntArray, mark: Click) -> tuple[Selection, str]:
        """Select the object at a pixel, or the region around it where nothing stands."""
        found, how = select_by_click(view, mark.x, mark.y)
        if how == "alone" and len(rows) < len(state.mask):  # what is not drawn may be a part of it
            view, rows = replace(view, gaussians=self._scene), np.arange(len(state.mask))
            found, how = select_by_click(view, mark.x, mark.y)
        return _combined(state, found, rows, mark.effect, how)

    def _box(self, state: Selection, mark: Box) -> tuple[Selection, str]:
        view, rows = self._viewed(mark.view)
        box = mark.x0, mark.y0, mark.x1, mark.y1
        found, how = select_by_box(view, box)
        taken = np.count_nonzero(found & state.mask[rows])
        if mark.effect != "remove" or taken <= _BOX_TAKES_ALL * np.count_nonzero(state.mask):
            return _combined(state, found, rows, mark.effect, how)
        pixels, depths = view.camera.project(self._scene.means.astype(np.float64))
        within = (depths > 0) & (pixels >= box[:2]).all(axis=1) & (pixels < box[2:]).all(axis=1)
        return state.combined(np.asarray(within) & state.mask, mark.effect), INTERPRETATIONS["frame"]

    def _viewed(self, view: View) -> tuple[ViewedScene, IntArray]:
        """Return what is drawn in a view, and its rows in the scene."""
        assert isinstance(view, Viewpoint), "views are resolved"
        drawn, rows = drawn_part(self._scene, view)
        return ViewedScene(drawn, view.camera, self._up, self._seen_from), rows


def apply_marks(scene: Gaussians, marks: Marks, cameras: CameraSet | None) -> Selection:
    """Return what resolved marks select together.

    Raises:
        InputError: a mark is not possible, the marks are of another scene, or nothing is selected.
    """
    if not marks.marks:
        raise InputError("There is no mark; say what to select by a click, a box, a volume or a file.")
    if marks.scene_size not in (None, len(scene)):
        raise InputError(
            f"The marks were made in a scene of {marks.scene_size} Gaussians, and this one has {len(scene)}; give the "
            "scene that they were made in."
        )
    if cameras is None and marks.cameras is not None and any(isinstance(mark, FromMasks) for mark in marks.marks):
        cameras = read_camera_set(marks.cameras)
    interpreter = MarkInterpreter(scene, marks, cameras)
    state = Selection.nothing(len(scene))
    for mark in marks.marks:
        state = interpreter.apply(state, mark)
    if not state.mask.any():
        low, high = (" ".join(f"{x:.4g}" for x in ends) for ends in (scene.means.min(axis=0), scene.means.max(axis=0)))
        raise InputError(
            f"Nothing is selected after the last mark ({state.interpretations[-1]}); check that it belongs to this "
            f"scene, which reaches from {low} to {high}."
        )
    return replace(state, marks=marks)


def _near(state: Selection, view: ViewedScene, rows: IntArray, mark: Click, target: Target) -> tuple[Selection, str]:
    """Select what a click in a large capture means where no thing was found, by its surroundings alone."""
    distances = np.linalg.norm(view.gaussians.means - target.point.astype(np.float32), axis=1)
    near = np.flatnonzero(distances < target.depth / 2)
    around = replace(view, gaussians=view.gaussians.select(near))
    if pieces := pieces_at_click(around, look_at_pixel(around, mark.x, mark.y)):
        return _combined(state, pieces[0], rows[near], mark.effect, "piece")
    if (alone := seen_alone(view.small(), target)) is not None:
        return _combined(state, alone, rows, mark.effect, "alone")
    return _combined(state, select_around_click(around, mark.x, mark.y), rows[near], mark.effect, "around")


def _correction(
    state: Selection, view: ViewedScene, rows: IntArray, mark: Click, target: Target
) -> tuple[Selection, str]:
    """Add or remove a whole thing, or else move the boundary of the selection around a pixel.

    A thing that holds all that clicks have added is no whole one to remove: something that touches it is meant.

    Raises:
        InputError: the pixel is on the right side of the boundary already.
    """
    mask, adds = state.mask[rows], mark.effect == "add"
    for piece in pieces_at_click(view, target)[:1]:
        if is_meant_whole(piece, mask, mark.effect) and (adds or not _holds_all_clicks(state, view, rows, piece)):
            return _combined(state, piece, rows, mark.effect, "piece")
    small = view.small()
    x, y = mark.x * small.camera.width // view.camera.width, mark.y * small.camera.height // view.camera.height
    shown = np.asarray(small.coverage(mask) > HALF)
    if shown[y, x] == adds:
        alone = seen_alone(small, look_at_pixel(small, x, y)) if adds and len(state.interpretations) == 1 else None
        if alone is not None and alone[~mask].any() and alone[mask].mean() > HALF:
            return _combined(state, alone, rows, mark.effect, "alone")
        raise InputError(f"That is {'selected already' if adds else 'not selected'}; click where something is wrong.")
    seed = Seed(target.point, expected_radius(shown, x, y, target.depth, small.camera), adds)
    after = state.mask.copy()
    after[rows] = correct_at_click(small, mask, seed, state.seeds)
    state = replace(state, seeds=(*state.seeds, seed))
    return state.combined(after != state.mask, mark.effect), INTERPRETATIONS["region"]


def _holds_all_clicks(state: Selection, view: ViewedScene, rows: IntArray, piece: BoolArray) -> bool:
    """Tell whether a piece (M,) of what is drawn holds all that clicks have added and that is still selected."""
    held = nearest_to([place for place in state.seeds if place.inside], view.gaussians.means)
    held = held[state.mask[rows[held]]]
    return len(held) > 0 and bool(piece[held].all())


def _combined(state: Selection, found: BoolArray, rows: IntArray, effect: Effect, how: str) -> tuple[Selection, str]:
    """Combine with what was found, (M,), among M rows of the scene; the second value says how it was found."""
    return state.combined(mask_of_rows(rows[found], len(state.mask)), effect), INTERPRETATIONS[how]


def _sized(before: Selection, sizes: Sequence[IntArray], effect: Effect) -> Selection:
    """Return the state with the first of some things, by their rows; the others come if the click is made again."""
    after = before.combined(mask_of_rows(sizes[0], len(before.mask)), effect)
    return replace(after, other_sizes=tuple(sizes[1:]), before_click=before)


def _camera_at(place: Point) -> Camera:
    """Return a camera of which only the position counts."""
    pose = np.eye(4)
    pose[:3, 3] = -np.array(place)
    return Camera(pose, np.eye(3), 1, 1)
