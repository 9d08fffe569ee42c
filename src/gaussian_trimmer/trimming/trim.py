"""The trimmer: decide what belongs to each object, share out what several ask for, refine, remove, and assemble."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.gaussians import Gaussians, IntArray, LabelArray
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.removal.remove import Removal, remove
from gaussian_trimmer.removal.views import views_around
from gaussian_trimmer.trimming.arguments import Setup, set_up
from gaussian_trimmer.trimming.assembly import assemble_object, assemble_rest, assemble_result, resolve_overlaps
from gaussian_trimmer.trimming.clock import Clock, Progress
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.decision import Decision, decide_all, look
from gaussian_trimmer.trimming.result import THE_OBJECT, Once, SceneWithoutObjects, TrimResult
from gaussian_trimmer.trimming.up_vector import UpVector
from gaussian_trimmer.views.view import View


def trim(
    scene: Gaussians,
    selection: ArrayLike,
    *,
    config: TrimConfig | None = None,
    masks: Iterable[tuple[Camera, ArrayLike]] | None = None,
    cameras: CameraSet | Sequence[Camera] | None = None,
    views: int | None = None,
    view_cameras: Sequence[Camera] | None = None,
    up: str | ArrayLike | UpVector | None = None,
    excluded: ArrayLike | None = None,
    progress: Progress = lambda stage: None,
) -> TrimResult:
    """Sharpen a rough selection of one object: `trim_objects` of one.

    Args:
        scene: all N Gaussians; the object alone also works, without background augmentation.
        selection: the object, roughly: booleans (N,), N whole numbers that are 0 and 1 or 0 and 255, or the numbers of
            the object's rows, from 0, each once.
        progress: called with the name of each stage when it begins.
        config, masks, cameras, views, view_cameras, up, excluded: as those of `trim_objects`.

    Raises:
        InputError: as `trim_objects`.
    """
    return trim_objects(
        scene,
        {THE_OBJECT: selection},
        config=config,
        masks=masks,
        cameras=cameras,
        views=views,
        view_cameras=view_cameras,
        up=up,
        excluded=excluded,
        progress=progress,
    )


# More arguments than a function of this package has elsewhere: callers give all but two by name, and most give none.
def trim_objects(
    scene: Gaussians,
    objects: Mapping[Any, ArrayLike] | Sequence[ArrayLike] | NDArray[np.integer[Any]],
    *,
    config: TrimConfig | None = None,
    masks: Iterable[tuple[Camera, ArrayLike]] | None = None,
    cameras: CameraSet | Sequence[Camera] | None = None,
    views: int | None = None,
    view_cameras: Sequence[Camera] | None = None,
    up: str | ArrayLike | UpVector | None = None,
    excluded: ArrayLike | None = None,
    progress: Progress = lambda stage: None,
) -> TrimResult:
    """Sharpen rough selections of objects of one scene, which share no Gaussian afterwards.

    Each stage is also logged to "gaussian_trimmer" when it begins. The scene without the objects is made when it is
    first asked for.

    Args:
        scene: all N Gaussians.
        objects: the selections, each as `trim` takes it, by the objects' ids or names, or in a list. They may
            overlap; `find_objects(scene).selections()` gives those that are sure. What marks removed from one stays out
            of that one. Or the id of each Gaussian's object, integers (N,), 0 for none.
        config: settings of all stages.
        masks: what one object shows in some views, in place of the silhouettes of its corrected labels: pairs of a
            camera and a mask (H, W), booleans or floats above zero on the object. If these are the views that a trim
            looks from itself, as `views_to_segment` gives them, masks say which Gaussians belong to it; others are of
            pictures and also know its outline, which is fitted to them.
        cameras: the cameras that the scene was trained with, a set or a list, if known: they give the up vector and
            the range of angles from which an object was observed.
        views: number of virtual views of each object, in place of `config.plan.views`.
        view_cameras: cameras to look from in place of virtual ones: the "no virtual cameras" ablation.
        up: the up vector in the scene's coordinates, in place of `config.up`: three numbers, an axis, "z" or "-y", or
            as `find_up` returns it.
        excluded: booleans (N,), which Gaussians become part of no object unless they are selected.
        progress: called with the name of each stage when it begins, or with "object ID" when an object's turn comes.

    Raises:
        InputError: there is no object; a selection does not fit the scene, is empty or can be understood in two ways;
            a setting is out of its range; the scene holds numbers with which nothing can be computed; or the
            masks cannot be used, or are given for several objects.
    """
    setup, rough = set_up(scene, objects, config, masks, cameras, views, view_cameras, up, excluded)
    clock = Clock(progress)
    numbers = range(1, len(rough) + 1)
    decisions = decide_all(setup, rough, clock)
    with clock("share out"):
        owner, contested = resolve_overlaps(scene, [d.rows for d in decisions], [part.rows for part in rough])
    with clock("refine"):
        assembled = list(parallel_map(partial(assemble_object, setup, owner), _light(decisions), numbers))

    def rest() -> SceneWithoutObjects:
        changes = list[tuple[IntArray, Removal] | None]([None] * len(rough))
        if setup.config.background != "exact":
            with clock("remove"):
                changes = list(parallel_map(partial(_remove, setup, owner), _light(decisions), numbers))
        with clock("assemble"):
            return assemble_rest(scene, assembled, owner, changes)

    return assemble_result(
        setup, [part for part, _ in assembled], owner, decisions, Once(rest), contested, clock.seconds
    )


def views_to_segment(
    scene: Gaussians,
    selection: ArrayLike,
    *,
    config: TrimConfig | None = None,
    cameras: CameraSet | Sequence[Camera] | None = None,
    views: int | None = None,
    view_cameras: Sequence[Camera] | None = None,
    up: str | ArrayLike | UpVector | None = None,
    excluded: ArrayLike | None = None,
) -> tuple[list[View], Gaussians]:
    """Return the views that a trim with these arguments looks from, in order of yaw, and the Gaussians that they show.

    Masks drawn in them go to `trim` as pairs of a view's `camera` and the mask. There are no views of a selection that
    a trim would leave as it is.

    Raises:
        InputError: as `trim`.
    """
    setup, (rough,) = set_up(scene, {THE_OBJECT: selection}, config, None, cameras, views, view_cameras, up, excluded)
    return look(setup, rough)


def _light(decisions: Sequence[Decision]) -> Iterator[Decision]:
    """Yield decisions, of several each without the Gaussians that an earlier stage has looked up."""
    return iter(decisions) if len(decisions) == 1 else (decision.without_pictures() for decision in decisions)


def _remove(setup: Setup, owner: LabelArray, decision: Decision, number: int) -> tuple[IntArray, Removal] | None:
    """Return the scene rows of the Gaussians around an object, and what changes among them without it.

    None if it is left as it was, or has nothing left.
    """
    crop, config = decision.crop, setup.config
    if decision.members is None or not (owner[crop.rows] == number).any():
        return None
    up, size = crop.bounds.axes[2], config.refinement.size
    pruned = None if decision.pruned is None else decision.pruned & (owner[crop.rows] == 0)
    views = views_around(setup.scene, crop.local, crop.rows, owner, number, up, crop.cameras, size, pruned)
    return crop.rows, remove(views, fill=config.background == "filled", with_standing=config.with_what_stands_on_it)
