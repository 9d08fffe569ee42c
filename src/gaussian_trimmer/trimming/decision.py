"""Decide which Gaussians belong to one object: from the plan of the views to the cut at its boundary.

Which rows are the object's is, in turn: a selection of the crop, a probability of each of its Gaussians, masks in
views, and the members of a `Decision`. `resolve_overlaps` makes owners in the scene of the members of all objects,
`assemble_object` makes `Pieces` of those that are an object's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import training_cameras
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, LabelArray, mask_of_rows
from gaussian_trimmer.geometry.support_plane import SupportPlane, find_support_plane
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.trimming.acceptance import check_masks, excessive_loss, rejection
from gaussian_trimmer.trimming.alpha_targets import OutlineViews, resized_mask
from gaussian_trimmer.trimming.arguments import RoughObject, Setup
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.crop import SceneCrop, complete_views, crop_scene, draw_views
from gaussian_trimmer.trimming.diagnosis import find_wrong_input, selection_warning, up_warning
from gaussian_trimmer.trimming.evidence import prune
from gaussian_trimmer.trimming.label_crf import correct_labels
from gaussian_trimmer.trimming.up_vector import KNOWN_SOURCES, UpVector, find_up
from gaussian_trimmer.views.small_views import FAR_FOV_DEGREES, close_up_of, views_at_heights
from gaussian_trimmer.views.view import HALF, TrimmedView, View, visible_weight, without_pictures
from gaussian_trimmer.views.virtual_cameras import PlanConfig

if TYPE_CHECKING:  # nothing is cut by default
    from gaussian_trimmer.trimming.straddlers import CutGaussians

_LEAST_FREE_VIEWS = 3
"""Directions that show at least half of an object, of those that are tried: with fewer its other sides are a guess."""


@dataclass(frozen=True, eq=False)
class Decision:
    """What belongs to an object, before it is compared with others, fitted and put together."""

    rough: RoughObject
    crop: SceneCrop
    up: UpVector
    warnings: tuple[str, ...]
    views: tuple[TrimmedView, ...] = ()
    """All views, accepted or not; none if an input was found wrong."""
    outline: OutlineViews | None = None
    """Small views of the object; None if it is left as it was."""
    members: BoolArray | None = None
    """Which Gaussians of the crop belong to it, whole or in part, (L,); None if the selection is left as it was."""
    pruned: BoolArray | None = None
    """Which of the selected ones pruning took from it, (L,); None where masks decide, or as `members`."""
    before_strokes: BoolArray | None = None
    """Which did before strokes on its cut-out settled some, (L,); None if none did."""
    cut: CutGaussians | None = None
    """Those that belong to it in part; None if there are none."""
    probability: FloatArray | None = None
    """Probability that each Gaussian of the crop is the object's by the corrected labels, (L,)."""
    refused: str | None = None
    """Why it is left as it was."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Time taken by each stage."""

    @property
    def considered(self) -> IntArray:
        """Scene rows, ascending, of all Gaussians that could be the object's."""
        return self.rough.rows if self.members is None else self.crop.rows

    @property
    def rows(self) -> IntArray:
        """Scene rows, ascending, of those that it asks for."""
        return self.rough.rows if self.members is None else self.crop.rows[self.members]

    @property
    def share(self) -> FloatArray:
        """How much of each of those that could be the object's is its own, from 0 to 1, (L,)."""
        return np.ones(len(self.considered), np.float32) if self.probability is None else self.probability

    def owned(self, owner: LabelArray, number: int) -> IntArray:
        """Return scene rows, ascending, of those that it gets, by the number of each Gaussian's object, (N,)."""
        return np.asarray(self.considered[owner[self.considered] == number])

    def settled_by(self, rough: RoughObject) -> Decision:
        """Return the same with what strokes on the object's cut-out put on the other side of the boundary."""
        if self.members is None or rough.settled is None:
            return replace(self, rough=rough)
        rows = np.union1d(self.crop.rows, np.intersect1d(rough.touched, rough.rows))  # a stroke reaches anywhere
        places, touched = np.searchsorted(rows, self.crop.rows), np.isin(rows, rough.touched)

        def among_all(values: NDArray[Any]) -> NDArray[Any]:
            spread = np.zeros(len(rows), values.dtype)
            spread[places] = values
            return spread

        crop = self.crop
        crop = replace(crop, rows=rows, selected=among_all(crop.selected), excluded=among_all(crop.excluded))
        members = np.where(touched, np.isin(rows, rough.rows), among_all(self.members))
        cut = self.cut and replace(self.cut, rows=places[self.cut.rows])
        outline = self.outline and replace(self.outline, projected={})  # of the crop as it was
        probability = None if self.probability is None else among_all(self.probability)
        decided = replace(self, rough=rough, crop=crop, outline=outline, probability=probability)
        pruned = None if self.pruned is None else among_all(self.pruned) & ~touched
        return replace(decided, members=members, pruned=pruned, before_strokes=among_all(self.members), cut=cut)

    def without_pictures(self) -> Decision:
        """Return the same in little memory: neither Gaussians nor pixels are kept."""
        outline, views = self.outline and replace(self.outline, projected={}), tuple(map(without_pictures, self.views))
        return replace(self, crop=self.crop.without_copies(), outline=outline, views=views)


def decide_all(setup: Setup, rough: Sequence[RoughObject], clock: Clock) -> list[Decision]:
    """Decide what belongs to each object; what several have in common is found once."""
    if len(rough) == 1:
        return [decide(setup, rough[0], clock)]
    selected = np.zeros(len(setup.scene), np.bool_)
    for part in rough:
        selected[part.rows] = True
    up = setup.up or find_up(setup.scene, setup.cameras, setup.config.up, selected)
    if up.source in KNOWN_SOURCES:
        setup = replace(setup, up=up, up_warning=up_warning(setup.scene, selected, up))

    def decided(part: RoughObject) -> Decision:
        own_clock = Clock(lambda stage: None)
        decision = decide(setup, part, own_clock).without_pictures()
        return replace(decision, seconds=own_clock.seconds)

    decisions, found = [], parallel_map(decided, rough)
    for part in rough:
        with clock(f"object {part.id}"):
            decisions.append(next(found))
    return decisions


def decide(setup: Setup, rough: RoughObject, clock: Clock) -> Decision:
    """Decide which Gaussians belong to an object as if it were the only one."""
    return _decide(setup, rough.undecided, clock).settled_by(rough)


def _decide(setup: Setup, rough: RoughObject, clock: Clock) -> Decision:
    config = setup.config
    with clock("plan"):
        crop, up, warnings, wrong = _plan(setup, rough)
    decision = partial(Decision, rough, crop, up, warnings)
    if wrong:
        return decision(refused=wrong)
    unsegmented, probability, visible, visible_alone = _look(setup, crop, clock)
    with clock("segment"):
        masks = [mask for _, mask in setup.masks] if setup.masks else [view.silhouette for view in unsegmented]
        views = check_masks(unsegmented, masks, config.acceptance, judged=setup.masks is not None)
    decision = partial(decision, views=tuple(views))
    refused = rejection(views, config.acceptance)
    if refused:
        return decision(refused=refused)
    if setup.masks or config.split.rule != "none":
        from gaussian_trimmer.trimming.paper import decide_by_masks  # late, since a default trim has no need of it

        members, cut = decide_by_masks(crop.shown, crop.selected, probability, views, config, clock)
    else:
        members, cut = (probability > HALF) & (crop.selected | config.evidence.recover), None
    with clock("prune"):
        positions, weights = crop.local.means / np.float32(crop.bounds.radius), visible.astype(np.float64)
        plane = find_support_plane(positions, members, weights, crop.bounds, config.label_crf.support_plane)
        outline = _outline_views(setup, crop, [view for view in views if not view.rejected], plane)
        decided = members
        if config.evidence.min_in_place > 0:
            members = prune(crop.local, members, crop.selected, outline, config.evidence.min_in_place, cut)
        pruned = None if setup.masks else decided & crop.selected & ~members  # masks may tell that it is another's
    refused = excessive_loss(crop.selected, members, visible, visible_alone, config.acceptance)
    if refused:
        return decision(refused=refused)
    cut = cut and cut.select(members[cut.rows])
    return decision(outline=outline, members=members, pruned=pruned, cut=cut, probability=probability)


def look(setup: Setup, rough: RoughObject) -> tuple[list[View], Gaussians]:
    """Return the views of an object that masks are to be drawn in, none if it is refused, and what they show."""
    crop, _, _, wrong = _plan(setup, rough.undecided)
    return [] if wrong else _look(setup, crop, Clock(lambda stage: None, log=None))[0], crop.shown


def _look(setup: Setup, crop: SceneCrop, clock: Clock) -> tuple[list[View], FloatArray, FloatArray, FloatArray]:
    """Return the views of a crop of L Gaussians, of which S are selected, and what they tell of these.

    That is the corrected label of each, (L,), its blend weight in the views, (L,), and that of each selected one where
    these are alone, (S,), in pixels of five views of 512 x 512.
    """
    with clock("render"):
        pictures, objects = draw_views(crop)
        visible, alone = (
            visible_weight(drawn.weights[:, : len(crop.rows), 0], crop.cameras) for drawn in (pictures, objects)
        )
        alone = alone[crop.selected]
    with clock("correct"):
        probability = correct_labels(crop.local, crop.selected, visible, crop.bounds, setup.config.label_crf)
        probability[crop.excluded] = 0
    with clock("render"):
        return complete_views(crop, pictures, objects, probability), probability, visible, alone


def _plan(setup: Setup, rough: RoughObject) -> tuple[SceneCrop, UpVector, tuple[str, ...], str | None]:
    """Return where to look from, the up vector, warnings, and which input is wrong, if one is."""
    scene, selection = setup.scene, mask_of_rows(rough.rows, len(setup.scene))
    up = setup.up or find_up(scene, setup.cameras, setup.config.up, selection)
    crop = crop_scene(setup, selection, _excluded(setup, rough), up.direction, rough.marked_from)
    wrong = find_wrong_input(scene, selection, crop.bounds, training_cameras(setup.cameras))
    doubt = setup.up_warning
    if setup.up is None and not wrong:
        doubt = up_warning(scene, selection, up)
    found = (selection_warning(scene, selection), doubt, None if wrong else _sight_warning(crop))
    return crop, up, tuple(warning for warning in found if warning), wrong


def _sight_warning(crop: SceneCrop) -> str | None:
    """Say that the scene hides the object from nearly everywhere, a sentence; None if it does not."""
    if crop.chosen is None or crop.chosen.free >= _LEAST_FREE_VIEWS:
        return None
    best = np.degrees(crop.chosen.yaws[0]) % 360
    return (
        f"{f'Only {crop.chosen.free}' if crop.chosen.free else 'None'} of the directions that were tried show half of "
        f"the object; the best is at {best:.0f} degrees. Look at its other sides."
    )


def _excluded(setup: Setup, rough: RoughObject) -> BoolArray:
    """Return which Gaussians of the scene may not join an object, (N,)."""
    none = np.zeros(len(setup.scene), np.bool_)
    from_all, from_it = (none if mask is None else mask for mask in (setup.excluded, rough.excluded))
    return from_all | from_it | setup.scene.blank


def _outline_views(
    setup: Setup, crop: SceneCrop, accepted: Sequence[TrimmedView], plane: SupportPlane | None
) -> OutlineViews:
    """Return small views of an object: from several heights, or cut out of the views of given cameras.

    Masks of pictures know more of the object's outline than the scene does.
    """
    settings, bounds, masks = setup.config.refinement, crop.bounds, None
    if crop.pictured or setup.view_cameras:
        close = [close_up_of(trimmed.view.camera, bounds, settings.size) for trimmed in accepted]
        cameras = [camera for camera, _ in close]
        if crop.pictured:
            masks = [resized_mask(v.mask[part], camera) for v, (camera, part) in zip(accepted, close, strict=True)]
    elif crop.chosen:
        cameras = crop.chosen.cameras(settings.views, settings.size, FAR_FOV_DEGREES, PlanConfig.fill)
    else:
        known = training_cameras(setup.cameras)
        cameras = views_at_heights(bounds, crop.cameras, known, settings.views, settings.size)
    # What lies deeper below the middle of the plane's layer than the layer is thick is below the ground.
    ground = None if plane is None else replace(plane.plane, offset=plane.plane.offset - 2 * plane.thickness)
    return OutlineViews(cameras, masks, bounds.radius, ground, crop.occluders)
