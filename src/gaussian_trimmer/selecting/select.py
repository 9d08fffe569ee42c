"""From marks to a selection: each adds to what those before it selected, removes from it, or keeps its share of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet, training_cameras
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.planning.up_vector import find_up
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, get_renderer
from gaussian_trimmer.segmentation.segmenters.mask_files import cameras_with_masks, mask_of
from gaussian_trimmer.selecting.clicks import (
    Pick,
    look_at_pixel,
    pieces_at_click,
    select_by_box,
    select_by_clicks,
    small_view,
)
from gaussian_trimmer.selecting.corrections import Seed, expected_radius, move_boundary
from gaussian_trimmer.selecting.lifting import lift_by_assignment, lift_by_vote
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
    Plane,
    Shrink,
    Sphere,
    View,
    Viewpoint,
)
from gaussian_trimmer.selecting.marks_file import is_marks_file, read_marks, write_marks
from gaussian_trimmer.selecting.model_masks import PromptableModel, select_by_model
from gaussian_trimmer.selecting.overview import drawn_rows, plan_overview
from gaussian_trimmer.selecting.shapes import grown, inside_shape, shrunk
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.views import HALF

_DISJOINT = 0.1
"""A thing of which a smaller share than this is selected is added as a whole."""
_MOST = 0.5
"""A thing of which a larger share than this is selected is removed as a whole, where others are selected too."""
_BESIDE = 0.2
"""Others are selected too if the rest of the selection is more than this, relative to the thing."""
_BOX_TAKES_ALL = 0.9
"""A box that would remove more than this share of the selection means only what is selected within its sides."""


@dataclass(frozen=True, eq=False)
class Selection:
    """What marks select; `trim` takes it as it is."""

    mask: BoolArray
    """(N,)."""
    marks: Marks
    """The marks, with everything that their meaning depends on."""
    ways: tuple[str, ...]
    """How each mark was understood."""
    excluded: BoolArray
    """What marks removed and none selected again, which a trim does not take in, (N,)."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The mask, for NumPy."""
        return np.array(self.mask, dtype, copy=bool(copy) or dtype not in (None, np.bool_))

    def save_marks(self, path: str | Path) -> None:
        """Write the marks to a .json file, from which `select` makes the selection again.

        Raises:
            InputError: the file cannot be written.
        """
        write_marks(self.marks, Path(path))


@dataclass(frozen=True, eq=False)
class Selected:
    """What the first few marks select, from which the next one goes on."""

    mask: BoolArray
    """(N,); not changed in place."""
    excluded: BoolArray
    """What marks removed and none selected again, (N,); not changed in place."""
    seeds: tuple[Seed, ...] = ()
    """What clicks have said about places."""
    ways: tuple[str, ...] = ()
    """How each mark was understood."""

    @classmethod
    def nothing(cls, n: int) -> Selected:
        """What no mark selects, in a scene of n Gaussians."""
        return cls(np.zeros(n, np.bool_), np.zeros(n, np.bool_))


class Selector:
    """Understands marks one at a time: what `select` does for a whole list, without beginning anew at each mark."""

    def __init__(
        self, scene: Gaussians, marks: Marks, *, cameras: CameraSet | None = None,
        renderer: Renderer | str = DEFAULT_RENDERER, model: PromptableModel | None = None,
    ) -> None:  # fmt: skip
        """Marks are understood with the up vector, and the places of the photographs, of a list of settled marks.

        Args:
            scene: all N Gaussians.
            marks: settled marks; which ones they are does not matter here.
            cameras: the cameras of the pictures that masks belong to.
            renderer: a renderer, or the name of one.
            model: as for `select`.
        """
        renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
        seen_from = tuple(_camera_at(place) for place in marks.photographed_from)
        self._scene = _Scene(scene, np.array(marks.up), seen_from, cameras, renderer, model)

    def apply(self, before: Selected, mark: Mark) -> Selected:
        """The selection after one more mark, whose view is settled; nothing may remain selected.

        Raises:
            InputError: the mark is not possible, or nothing is seen at its pixels.
        """
        state = _State(before.mask, before.excluded, list(before.seeds))
        way = _apply(self._scene, state, mark, len(before.ways) + 1)
        return Selected(state.mask, state.excluded & ~state.mask, tuple(state.seeds), (*before.ways, way))


@dataclass(eq=False)
class _State:
    """The selection so far, and what was said about places in it."""

    mask: BoolArray
    excluded: BoolArray
    seeds: list[Seed] = field(default_factory=list)

    def combine(self, found: BoolArray, effect: Effect) -> None:
        """Take in what a mark means, (N,); what one removes is excluded whether or not it was selected."""
        self.mask = combined(self.mask, found, effect)
        if effect == "remove":
            self.excluded = self.excluded | found


@dataclass(frozen=True, eq=False)
class _Scene:
    """What all marks are understood with."""

    gaussians: Gaussians
    up: Float64Array
    seen_from: tuple[Camera, ...]
    cameras: CameraSet | None
    renderer: Renderer
    model: PromptableModel | None


def select(
    scene: Gaussians,
    marks: Sequence[Mark] | Marks | str | Path,
    *,
    cameras: CameraSet | None = None,
    up: Any = None,
    views: Sequence[Viewpoint] | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    model: PromptableModel | None = None,
) -> Selection:
    """Select Gaussians by marks: clicks and boxes in views, volumes, files and masks, in order.

    Args:
        scene: all N Gaussians.
        marks: a list of marks; or marks that were saved, or their file: then `cameras` and `up` are known.
        cameras: the cameras that the scene was trained with, if known. Marks name their views.
        up: the scene's up vector, (3,), if known.
        views: the views that marks can name, in place of those of `cameras`, or of eight from all around.
        renderer: a renderer, or the name of one.
        model: draws masks for boxes and first clicks in views; without one they are understood by surface and colour.

    Raises:
        InputError: a mark is not possible, a view is not known, nothing is seen at a pixel, or nothing is selected.
    """
    renderer = get_renderer(renderer) if isinstance(renderer, str) else renderer
    if isinstance(marks, str | Path):
        marks = read_marks(marks)
    if not isinstance(marks, Marks):
        marks = settle_marks(scene, marks, cameras=cameras, up=up, views=views)
    if not marks.marks:
        raise InputError("There is no mark; say what to select by a click, a box, a volume or a file.")
    if marks.scene_size not in (None, len(scene)):
        raise InputError(
            f"The marks were made in a scene of {marks.scene_size} Gaussians, and this one has {len(scene)}; give the "
            "scene that they were made in."
        )
    if cameras is None and marks.cameras is not None and any(isinstance(mark, FromMasks) for mark in marks.marks):
        cameras = read_camera_set(marks.cameras)
    selector = Selector(scene, marks, cameras=cameras, renderer=renderer, model=model)
    made = Selected.nothing(len(scene))
    for mark in marks.marks:
        made = selector.apply(made, mark)
    if not made.mask.any():
        raise InputError(
            "No Gaussian is selected after the last mark; check that the cameras, masks and views belong to this scene."
        )
    return Selection(made.mask, marks, made.ways, made.excluded)


def settle_marks(
    scene: Gaussians, marks: Sequence[Mark], *, cameras: CameraSet | None = None, up: Any = None,
    views: Sequence[Viewpoint] | None = None, camera_path: Path | None = None,
) -> Marks:  # fmt: skip
    """Marks whose views are looked up, with the up vector and the places that the scene was photographed from.

    Args:
        camera_path: where the cameras came from, if known.

    Raises:
        InputError: a view is not known.
    """
    found = find_up(scene, cameras, up)
    known: Sequence[Viewpoint] | None = views
    settled = []
    for mark in marks:
        if isinstance(mark, Click | Box) and not isinstance(mark.view, Viewpoint):
            if isinstance(mark.view, Camera):
                mark = replace(mark, view=Viewpoint(mark.view))
            else:
                known = views_to_click_in(scene, cameras, found.direction) if known is None else known
                mark = replace(mark, view=find_view(known, mark.view))
        settled.append(mark)
    x, y, z = found.direction.tolist()
    photographed = tuple(_place(camera) for camera in training_cameras(cameras))
    return Marks(tuple(settled), (x, y, z), photographed, len(scene), camera_path)


def views_to_click_in(scene: Gaussians, cameras: CameraSet | None, up: Float64Array) -> list[Viewpoint]:
    """The views of the cameras or, without cameras, eight from all around."""
    if cameras is not None:
        return [Viewpoint(camera) for camera in cameras.pinhole_cameras()]
    return plan_overview(scene, up).views


def find_view(views: Sequence[Viewpoint], wanted: View) -> Viewpoint:
    """The view of a name, with or without its ending, or else of a number from 0.

    Raises:
        InputError: there is none, or there are several.
    """
    if isinstance(wanted, Viewpoint):
        return wanted
    if isinstance(wanted, str):
        named = [view for view in views if wanted in (view.camera.name, Path(view.camera.name).stem)]
        if len(named) == 1:
            return named[0]
        if named or not wanted.isdigit():
            known = f"{views[0].camera.name} ... {views[-1].camera.name}" if views[0].camera.name else "numbered from 0"
            raise InputError(f"{len(named)} views are named '{wanted}'; the {len(views)} views are {known}.")
    number = int(wanted)  # type: ignore[arg-type]
    if not 0 <= number < len(views):
        raise InputError(f"There is no view {wanted}; the {len(views)} views are numbered from 0.")
    return views[number]


def _apply(context: _Scene, state: _State, mark: Mark, number: int) -> str:
    """Change the state by one mark; returns how it was understood."""
    if not state.mask.any() and getattr(mark, "effect", "remove") != "add":
        raise InputError(f"Mark {number} changes a selection, but nothing is selected before it; begin with others.")
    means = context.gaussians.means
    match mark:
        case Click():
            return _apply_click(context, state, mark)
        case Box():
            return _apply_box(context, state, mark)
        case Box3D() | Sphere() | Plane():
            state.combine(inside_shape(means, mark, context.up), mark.effect)
            return {Box3D: "a 3D box", Sphere: "a sphere", Plane: "what lies above a plane"}[type(mark)]
        case FromFile():
            found, notes = _from_file(context, mark)
            state.combine(found, mark.effect)
            return "; ".join([f"'{mark.path.name}'", *notes])
        case FromMasks():
            found, n = _lift(context, mark)
            state.combine(found, mark.effect)
            return f"{n} masks"
        case Grow():
            state.mask = grown(means, state.mask, mark.spacings)
            return f"grown by {mark.spacings:g} spacings"
        case Shrink():
            state.mask = shrunk(means, state.mask, mark.spacings)
            return f"shrunk by {mark.spacings:g} spacings"
    raise InputError(f"Mark {number} is a {type(mark).__name__}, which is no mark.")


def combined(before: BoolArray, found: BoolArray, effect: Effect) -> BoolArray:
    """A selection (N,) after another one was added to it, removed from it, or intersected with it.

    >>> combined(np.array([True, True, False]), np.array([True, False, True]), "remove").tolist()
    [False, True, False]
    """
    if effect == "add":
        return before | found
    return before & ~found if effect == "remove" else before & found


def _apply_click(context: _Scene, state: _State, mark: Click) -> str:
    view, rows, drawn = _drawn(context, mark.view)
    mask = state.mask[rows]
    pixel, small = (mark.x, mark.y), small_view(view.camera)
    if not state.mask.any() or mark.effect == "intersect":
        pick = _understood(context, drawn, view.camera, [pixel])
        state.combine(_in_scene(pick.selection, rows, len(state.mask)), mark.effect)
        return WAYS[pick.ways[0]]
    target = look_at_pixel(drawn, view.camera, *pixel, context.renderer)
    adds = mark.effect == "add"
    for piece in pieces_at_click(drawn, view.camera, target, context.up, context.renderer)[:1]:
        ours = np.count_nonzero(piece & mask)
        is_new = adds and ours < _DISJOINT * np.count_nonzero(piece)
        rest = np.count_nonzero(mask & ~piece)
        is_beside = not adds and ours > _MOST * np.count_nonzero(piece) and rest > _BESIDE * np.count_nonzero(piece)
        if is_new or is_beside:
            state.combine(_in_scene(piece, rows, len(state.mask)), mark.effect)
            return WAYS["piece"]
    shares = context.renderer.blend_values(drawn, small, mask.astype(np.float32)[:, None])[..., 0]
    x, y = mark.x * small.width // view.camera.width, mark.y * small.height // view.camera.height
    shown = np.asarray(shares > HALF)
    if shown[y, x] == adds:
        verb, already = ("adds", "selected already") if adds else ("removes", "not selected")
        raise InputError(f"The click at ({mark.x}, {mark.y}) {verb} what is {already}; click where something is wrong.")
    seed = Seed(target.point, expected_radius(shown, x, y, target.depth, small), adds)
    correction = move_boundary(drawn, small, mask, seed, state.seeds, context.up, context.renderer, context.seen_from)
    before, state.mask = state.mask, state.mask.copy()
    state.mask[rows] = correction.selection
    state.excluded = state.excluded | (before & ~state.mask)
    state.seeds.append(correction.seed)
    return WAYS["region"]


def _apply_box(context: _Scene, state: _State, mark: Box) -> str:
    view, rows, drawn = _drawn(context, mark.view)
    box = mark.x0, mark.y0, mark.x1, mark.y1
    pick = _understood(context, drawn, view.camera, box)
    found = _in_scene(pick.selection, rows, len(state.mask))
    if mark.effect == "remove" and np.count_nonzero(found & state.mask) > _BOX_TAKES_ALL * np.count_nonzero(state.mask):
        pixels, depths = view.camera.project(context.gaussians.means.astype(np.float64))
        low, high = np.array(box[:2]), np.array(box[2:])
        found = np.asarray((depths > 0) & (pixels >= low).all(axis=1) & (pixels < high).all(axis=1))
        state.combine(found & state.mask, mark.effect)
        return WAYS["frame"]
    state.combine(found, mark.effect)
    return WAYS[pick.ways[0]]


def _understood(
    context: _Scene, drawn: Gaussians, camera: Camera, meant: list[tuple[int, int]] | tuple[int, int, int, int]
) -> Pick:
    """What pixels, or a box, mean in a view."""
    if context.model is not None:
        return select_by_model(drawn, camera, meant, context.up, context.renderer, context.model, context.seen_from)
    if isinstance(meant, tuple):
        return select_by_box(drawn, camera, meant, context.up, context.renderer, context.seen_from)
    return select_by_clicks(drawn, camera, meant, context.up, context.renderer, context.seen_from)


WAYS = {
    "piece": "an object that stands on a surface",
    "part": "the part that is marked, on all of its sides",
    "colour": "what has its colour in that view, on all of its sides",
    "region": "the region around the click, by which the boundary moved",
    "frame": "all that is selected in the box",
}
"""How marks in views are understood."""


def _drawn(context: _Scene, view: View) -> tuple[Viewpoint, IntArray, Gaussians]:
    """A view, and the rows and Gaussians that are drawn in it."""
    assert isinstance(view, Viewpoint), "views are settled"
    rows = drawn_rows(context.gaussians.means, view)
    return view, rows, context.gaussians if len(rows) == len(context.gaussians) else context.gaussians.select(rows)


def _in_scene(part: BoolArray, rows: IntArray, n: int) -> BoolArray:
    mask = np.zeros(n, np.bool_)
    mask[rows[part]] = True
    return mask


def _from_file(context: _Scene, mark: FromFile) -> tuple[BoolArray, list[str]]:
    """What a selection file, or a file of marks, selects, (N,), and what should be known of how it was understood."""
    if is_marks_file(mark.path):
        marks = read_marks(mark.path)
        if any(isinstance(inner, FromFile) and is_marks_file(inner.path) for inner in marks.marks):
            raise InputError(
                f"'{mark.path}' holds marks that are of files of marks again; save what they select instead."
            )
        made = select(context.gaussians, marks, cameras=context.cameras, renderer=context.renderer, model=context.model)
        return made.mask, [f"{len(marks.marks)} marks"]
    notes: list[str] = []
    return load_selection(mark.path, context.gaussians, mark.options, notes.append), notes


def _lift(context: _Scene, mark: FromMasks) -> tuple[BoolArray, int]:
    """The selection (N,) by a folder of masks, and their number."""
    if context.cameras is None:
        raise InputError("Masks need the cameras of their pictures.")
    posed = cameras_with_masks(context.cameras.pinhole_cameras(), mark.folder)
    masks = [mask_of(camera, mark.folder) for camera in posed]
    if mark.method == "vote":
        return lift_by_vote(context.gaussians, posed, masks, mark.threshold), len(posed)
    return lift_by_assignment(context.gaussians, posed, masks, context.renderer, mark.gamma), len(posed)


def _place(camera: Camera) -> tuple[float, float, float]:
    x, y, z = camera.centre.tolist()
    return x, y, z


def _camera_at(place: tuple[float, float, float]) -> Camera:
    """A camera of which only the position counts."""
    pose = np.eye(4)
    pose[:3, 3] = -np.array(place)
    return Camera(pose, np.eye(3), 1, 1)
