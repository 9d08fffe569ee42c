"""What marks mean: each adds to what those before it selected, removes from it, or keeps its share of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet, Point, Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.tiles import LARGEST_LOOK
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, mask_of_rows
from gaussian_trimmer.geometry.storey import find_storey
from gaussian_trimmer.masks.mask_files import cameras_with_masks, mask_of
from gaussian_trimmer.selecting.clicks import (
    NothingFoundError,
    Pick,
    pieces_at_click,
    seen_alone,
    select_around_click,
    select_by_box,
    select_by_click,
    select_by_colour,
)
from gaussian_trimmer.selecting.corrections import correct_at_click, expected_radius, is_meant_whole
from gaussian_trimmer.selecting.lifting import lift_by_assignment
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
from gaussian_trimmer.selecting.model_masks import PromptableModel, select_by_model
from gaussian_trimmer.selecting.selection import Seed, Selection
from gaussian_trimmer.selecting.shapes import grown, inside_shape, shrunk
from gaussian_trimmer.selecting.strokes import drawn_over
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.surface.overview import drawn_part
from gaussian_trimmer.surface.viewed_scene import Target, ViewedScene, look_at_pixel
from gaussian_trimmer.trimming.stroke_cuts import StrokeCut
from gaussian_trimmer.views.view import HALF

if TYPE_CHECKING:
    from gaussian_trimmer.finding.at_point import ThingsAtPoints

_BOX_TAKES_ALL = 0.9
"""A box that would remove more than this share of the selection means only what is selected within its sides."""
INTERPRETATIONS = {
    "piece": "an object that stands on a surface",
    "alone": "all that is seen there, with nothing beside it",
    "part": "the part in the box, its back included",
    "around": "the region around the click, as nothing there stands on a surface; drag 'Tolerance', or draw around it",
    "colour": "what goes on from there in a colour like it",
    "size": "the next larger or smaller thing there, as the click was made again",
    "region": "the region around the click, by which the boundary moved",
    "frame": "all that is selected in the box",
}
"""How marks in views are understood."""


class MarkInterpreter:
    """Understands marks one at a time: what `select` does for a whole list, without beginning anew at each mark."""

    def __init__(
        self,
        scene: Gaussians,
        marks: Marks,
        *,
        cameras: CameraSet | None = None,
        model: PromptableModel | None = None,
    ) -> None:
        """Take the up vector, and the places of the photographs, from a list of resolved marks.

        Args:
            scene: all N Gaussians.
            marks: resolved marks; which ones they are does not matter here.
            cameras: the cameras of the pictures that masks belong to.
            model: as for `select`.
        """
        self._scene, self._up, self._cameras, self._model = scene, np.array(marks.up), cameras, model
        self._seen_from = tuple(_camera_at(place) for place in marks.photographed_from)
        self._things: ThingsAtPoints | None = None
        if len(scene) > LARGEST_LOOK or find_storey(scene, self._up).is_room:
            from gaussian_trimmer.finding.at_point import ThingsAtPoints  # takes a second to import

            self._things = ThingsAtPoints(scene, self._up)

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
        after, interpretation = self._applied(before, mark, number)
        if not isinstance(mark, Click):
            after = replace(after, other_sizes=(), before_click=None)
        return replace(after, interpretations=(*before.interpretations, interpretation))

    def _applied(self, state: Selection, mark: Mark, number: int) -> tuple[Selection, str]:
        means = self._scene.means
        match mark:
            case Click():
                return self._click(state, mark)
            case Box():
                return self._box(state, mark)
            case Box3D() | Sphere():
                name = "a 3D box" if isinstance(mark, Box3D) else "a sphere"
                return state.combined(inside_shape(means, mark, self._up), mark.effect), name
            case Rows():
                combined = state.combined(mark.mask(len(means)), mark.effect)
                if mark.cut is not None:
                    cut = StrokeCut(*drawn_over(mark.cut), np.zeros(len(means), np.bool_))
                    combined = replace(combined, cuts=(*combined.cuts, cut))
                return combined, mark.tool
            case FromFile():
                if identify(mark.path).kind == "marks":
                    raise InputError(f"'{mark.path}' holds marks; give the .npy beside it, which they selected.")
                notes = [f"'{mark.path.name}'"]
                found = load_selection(mark.path, self._scene, mark.options, notes.append)
                return state.combined(found, mark.effect), "; ".join(notes)
            case FromMasks():
                found, n = self._lifted(mark)
                return state.combined(found, mark.effect), f"{n} masks"
            case Grow():
                mask = grown(means, state.mask, mark.spacings)
                return state.combined(mask, "add"), "grown"
            case Shrink():
                mask = shrunk(means, state.mask, mark.spacings)
                return replace(state, mask=mask), "shrunk"

    def _click(self, state: Selection, mark: Click) -> tuple[Selection, str]:
        view, rows = self._viewed(mark.view)
        sizes, before = state.other_sizes, state.before_click
        state = replace(state, other_sizes=(), before_click=None)
        if mark.tolerance:
            return self._picked(state, select_by_colour(view, mark.x, mark.y, mark.tolerance), rows, mark.effect)
        first = not state.mask.any() or mark.effect == "intersect"
        if self._things is not None and not (first and self._model):
            target = look_at_pixel(view, mark.x, mark.y)
            seen = np.zeros(len(state.mask), np.float32)
            seen[rows] = target.seeds
            if before and sizes and mark.effect == "add" and 2 * seen[state.mask].sum() > seen.sum():
                return _sized(before, sizes, mark.effect), INTERPRETATIONS["size"]
            things = self._things.at(target.point, seen)
            if things and (first or is_meant_whole(mask_of_rows(things[0], len(seen)), state.mask, mark.effect)):
                return _sized(state, things, mark.effect), INTERPRETATIONS["piece"]
            if first:
                return self._near(state, view, rows, mark, target)
        if first:
            pick = self._interpreted(view, (mark.x, mark.y))
            if pick.kind == "alone" and len(rows) < len(state.mask):  # what is not drawn may be a part of it
                view, rows = replace(view, gaussians=self._scene), np.arange(len(state.mask))
                pick = self._interpreted(view, (mark.x, mark.y))
            return self._picked(state, pick, rows, mark.effect)
        mask, target = state.mask[rows], look_at_pixel(view, mark.x, mark.y)
        for piece in pieces_at_click(view, target)[:1]:
            if is_meant_whole(piece, mask, mark.effect):
                return self._picked(state, Pick(piece, "piece"), rows, mark.effect)
        small, adds = view.small(), mark.effect == "add"
        x, y = mark.x * small.camera.width // view.camera.width, mark.y * small.camera.height // view.camera.height
        shown = np.asarray(small.coverage(mask) > HALF)
        if shown[y, x] == adds:
            alone = seen_alone(small, look_at_pixel(small, x, y)) if adds and len(state.interpretations) == 1 else None
            if alone is not None and alone[~mask].any() and alone[mask].mean() > HALF:
                return self._picked(state, Pick(alone, "alone"), rows, mark.effect)
            raise InputError(
                f"That is {'selected already' if adds else 'not selected'}; click where something is wrong."
            )
        seed = Seed(target.point, expected_radius(shown, x, y, target.depth, small.camera), adds)
        after = state.mask.copy()
        after[rows] = correct_at_click(small, mask, seed, state.seeds)
        state = replace(state, seeds=(*state.seeds, seed))
        return state.combined(after != state.mask, mark.effect), INTERPRETATIONS["region"]

    def _near(
        self, state: Selection, view: ViewedScene, rows: IntArray, mark: Click, target: Target
    ) -> tuple[Selection, str]:
        """Select what a click in a large capture means where no thing was found, by its surroundings alone."""
        distances = np.linalg.norm(view.gaussians.means - target.point.astype(np.float32), axis=1)
        near = np.flatnonzero(distances < target.depth / 2)
        around = replace(view, gaussians=view.gaussians.select(near))
        if pieces := pieces_at_click(around, look_at_pixel(around, mark.x, mark.y)):
            return self._picked(state, Pick(pieces[0], "piece"), rows[near], mark.effect)
        if (alone := seen_alone(view.small(), target)) is not None:
            return self._picked(state, Pick(alone, "alone"), rows, mark.effect)
        return self._picked(state, select_around_click(around, mark.x, mark.y), rows[near], mark.effect)

    def _box(self, state: Selection, mark: Box) -> tuple[Selection, str]:
        view, rows = self._viewed(mark.view)
        box = mark.x0, mark.y0, mark.x1, mark.y1
        pick = self._interpreted(view, box)
        taken = np.count_nonzero(pick.selection & state.mask[rows])
        if mark.effect != "remove" or taken <= _BOX_TAKES_ALL * np.count_nonzero(state.mask):
            return self._picked(state, pick, rows, mark.effect)
        pixels, depths = view.camera.project(self._scene.means.astype(np.float64))
        within = (depths > 0) & (pixels >= box[:2]).all(axis=1) & (pixels < box[2:]).all(axis=1)
        return state.combined(np.asarray(within) & state.mask, mark.effect), INTERPRETATIONS["frame"]

    def _interpreted(self, view: ViewedScene, mark: tuple[int, int] | tuple[int, int, int, int]) -> Pick:
        """Return what a pixel, or a box, means in a view."""
        if self._model is not None:
            return select_by_model(view, mark, self._model)
        if len(mark) == 4:
            return select_by_box(view, mark)
        try:
            return select_by_click(view, *mark)
        except NothingFoundError:
            return select_around_click(view, *mark)

    def _picked(self, state: Selection, pick: Pick, rows: IntArray, effect: Effect) -> tuple[Selection, str]:
        """Return the state with what was found among some rows of the scene."""
        found = mask_of_rows(rows[pick.selection], len(state.mask))
        return state.combined(found, effect), INTERPRETATIONS[pick.kind]

    def _viewed(self, view: View) -> tuple[ViewedScene, IntArray]:
        """Return what is drawn in a view, and its rows in the scene."""
        assert isinstance(view, Viewpoint), "views are resolved"
        drawn, rows = drawn_part(self._scene, view)
        return ViewedScene(drawn, view.camera, self._up, self._seen_from), rows

    def _lifted(self, mark: FromMasks) -> tuple[BoolArray, int]:
        """Return the selection (N,) by a folder of masks, and their number."""
        if self._cameras is None:
            raise InputError("Masks need the cameras of their pictures.")
        posed = cameras_with_masks(self._cameras.pinhole_cameras(), mark.folder)
        masks = [mask_of(camera, mark.folder) for camera in posed]
        return lift_by_assignment(self._scene, posed, masks, mark.gamma), len(posed)


def apply_marks(
    scene: Gaussians,
    marks: Marks,
    *,
    cameras: CameraSet | None,
    model: PromptableModel | None,
) -> Selection:
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
    interpreter = MarkInterpreter(scene, marks, cameras=cameras, model=model)
    state = Selection.nothing(len(scene))
    for mark in marks.marks:
        state = interpreter.apply(state, mark)
    if not state.mask.any():
        raise InputError(
            "No Gaussian is selected after the last mark; check that the cameras, masks and views belong to this scene."
        )
    return replace(state, marks=marks)


def _sized(before: Selection, sizes: Sequence[IntArray], effect: Effect) -> Selection:
    """Return the state with the first of some things, by their rows; the others come if the click is made again."""
    after = before.combined(mask_of_rows(sizes[0], len(before.mask)), effect)
    return replace(after, other_sizes=tuple(sizes[1:]), before_click=before)


def _camera_at(place: Point) -> Camera:
    """Return a camera of which only the position counts."""
    pose = np.eye(4)
    pose[:3, 3] = -np.array(place)
    return Camera(pose, np.eye(3), 1, 1)
