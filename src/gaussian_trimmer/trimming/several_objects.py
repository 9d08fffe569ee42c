"""Several objects of one scene: decided one by one, shared out, and finished; none has another's Gaussians.

What belongs to each object is decided as if it were alone. Where two of them claim a Gaussian, the one whose selection
had it keeps it, and else the one that most of its nearest neighbours belong to. Only then are outlines fitted. The
background is what no object has, but for what only the objects hid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.config import CONTEXT_RADIUS, TrimConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.neighbours import nearest
from gaussian_trimmer.planning.diagnosis import up_warning
from gaussian_trimmer.planning.place_views import views_of_place
from gaussian_trimmer.planning.up_vector import KNOWN_SOURCES, find_up
from gaussian_trimmer.removal.continuation import brightened
from gaussian_trimmer.removal.place import Place
from gaussian_trimmer.removal.removal import Removal, remove
from gaussian_trimmer.rendering import DEFAULT_RENDERER, Renderer, parallel_map
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, Segmenter
from gaussian_trimmer.trimming.arguments import check_scene, mask_of_excluded, mask_of_selection, settings
from gaussian_trimmer.trimming.clock import Clock
from gaussian_trimmer.trimming.objects_result import ObjectsResult, TrimmedObject
from gaussian_trimmer.trimming.task import KnownUp, PlugIns, Task
from gaussian_trimmer.trimming.trim import Decision, decide, finish
from gaussian_trimmer.views import TrimmedView, without_pictures

__all__ = ["ObjectsResult", "TrimmedObject", "share_out", "trim_objects"]

_VOTING_NEIGHBOURS = 8
"""Number of nearest Gaussians that decide to which of several objects one belongs."""
_NOBODY = -1


@dataclass(frozen=True, eq=False)
class _Claim:
    """What one object asks for: its task, and what was decided for it, without what is large."""

    id: int
    name: str
    task: Task
    decision: Decision
    clock: Clock
    view: TrimmedView | None
    """A view with its pictures, an accepted one if there is one."""

    @property
    def members(self) -> BoolArray:
        """Which Gaussians of the scene it asks for, (N,)."""
        if self.decision.parts is None:
            return self.task.selection
        members = np.zeros(len(self.task.scene), np.bool_)
        members[self.decision.scope.rows] = self.decision.parts.members
        return members


@dataclass(frozen=True, eq=False)
class _Rest:
    """The scene of N Gaussians without all objects."""

    nobodys: BoolArray
    """Gaussians that no object has, (N,)."""
    dropped: BoolArray
    """Those of them that the background has not, (N,)."""
    gain: FloatArray
    """How many times brighter each Gaussian is without the objects' shadows, (N,)."""
    filled: Gaussians
    not_filled: tuple[str, ...] = ()

    @classmethod
    def of(cls, scene: Gaussians, nobodys: BoolArray) -> _Rest:
        """Everything that no object has, as it is."""
        n = len(scene)
        return cls(nobodys, np.zeros(n, np.bool_), np.ones(n, np.float32), scene.select(slice(0)))

    @property
    def relit(self) -> IntArray:
        """Scene rows of Gaussians that become brighter."""
        return np.flatnonzero(self.nobodys & ~self.dropped & (self.gain > 1))


# The arguments are those of `trim`, by the same names.
def trim_objects(
    scene: Gaussians,
    objects: Mapping[Any, ArrayLike] | Sequence[ArrayLike] | IntArray,
    *,
    config: TrimConfig | None = None,
    renderer: Renderer | str = DEFAULT_RENDERER,
    segmenter: Segmenter | str = DEFAULT_SEGMENTER,
    cameras: CameraSet | None = None,
    views: int | None = None,
    up: str | ArrayLike | None = None,
    excluded: ArrayLike | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> ObjectsResult:
    """Sharpen rough selections of several objects of one scene, which share no Gaussian afterwards.

    Args:
        scene: all N Gaussians.
        objects: the selections, each as `trim` takes it, by the objects' ids or names, or in a list. They may
            overlap. What marks removed from one stays out of that one. Or the id of each Gaussian's object, integers
            (N,), 0 for none, such as `find_objects(scene).labels`.
        config: settings of all stages.
        renderer: a renderer, or the name of one.
        segmenter: a segmenter, or the name of one.
        cameras: the cameras that the scene was trained with, if known.
        views: number of virtual views of each object, in place of `config.plan.views`.
        up: the up vector in the scene's coordinates, in place of `config.up`: three numbers, or an axis, "z" or "-y".
        excluded: booleans (N,), which Gaussians become part of no object unless they are selected.
        progress: called with the id of each object, as text, when its turn comes.

    Raises:
        InputError: there is no object, or as `trim` for one of them.
    """
    named = _by_id(objects)
    config = settings(config, views, up, None)
    check_scene(scene, cameras)
    plug_ins, n = PlugIns.of(renderer, segmenter), len(scene)
    masks = [mask_of_selection(selection, n) for _, _, selection in named]
    known_up, from_all = _common_up(scene, np.any(masks, axis=0), config, cameras), mask_of_excluded(None, excluded, n)

    def claimed(number: int, name: str, selection: ArrayLike, mask: BoolArray) -> _Claim:
        kept_out = from_all | mask_of_excluded(selection, None, n)
        return _claim(number, name, Task(scene, mask, kept_out, config, plug_ins, cameras, known_up=known_up))

    clock, claims, found = Clock(progress), [], plug_ins.map(claimed, *zip(*named, strict=True), masks)
    for number, _, _ in named:
        with clock(f"object {number}"):
            claims.append(next(found))
    with clock("share out"):
        owner, contested = share_out(
            scene, [claim.members for claim in claims], [claim.task.selection for claim in claims]
        )
        shared = [_shared(claim, owner == place) for place, claim in enumerate(claims)]
    with clock("finish"):
        finished = list(plug_ins.map(_finished, shared))
    rest = _Rest.of(scene, owner == _NOBODY)
    if config.background != "exact":
        with clock("remove"):
            rest = remove_all(scene, shared, owner, plug_ins.renderer, fill=config.background == "filled")
    return ObjectsResult(
        scene=scene,
        objects=tuple(_trimmed(claim, result) for claim, result in zip(shared, finished, strict=True)),
        background_rows=np.flatnonzero((owner == _NOBODY) & ~rest.dropped & (rest.gain == 1)),
        outside_parts=concatenate([result.outside_parts for result in finished]),
        outside_source=np.concatenate([_outside_source(result) for result in finished]),
        contested=contested,
        relit_rows=rest.relit,
        relit=brightened(scene.select(rest.relit), rest.gain[rest.relit]),
        filled=rest.filled,
        not_filled=rest.not_filled,
        dropped=np.flatnonzero(rest.dropped),
        seconds=clock.seconds,
        used_renderer=plug_ins.given_renderer,
    )


def _by_id(objects: Any) -> list[tuple[int, str, ArrayLike]]:
    """Id, name and selection of each object; those without whole numbers as ids are counted from 1."""
    if isinstance(objects, np.ndarray):
        objects = _by_labels(objects)
    if not isinstance(objects, Mapping | Sequence) or isinstance(objects, str):
        raise InputError(
            f"The objects are a {type(objects).__name__}; give selections by id or name, such as {{1: mask}}, or a "
            "list of selections."
        )
    if not len(objects):
        raise InputError("There is no object to trim; give at least one id with its selection.")
    if not isinstance(objects, Mapping):
        objects = dict(enumerate(objects, 1))
    if all(isinstance(key, Integral) and not isinstance(key, bool) for key in objects):
        return [(int(key), str(key), selection) for key, selection in objects.items()]
    return [(number, str(name), selection) for number, (name, selection) in enumerate(objects.items(), 1)]


def _by_labels(labels: NDArray[Any]) -> dict[int, BoolArray]:
    if labels.ndim != 1 or labels.dtype.kind not in "iu":
        raise InputError(
            f"The objects are an array of {labels.dtype} {labels.shape}; give the id of each Gaussian's object as "
            "integers (N,), 0 for none, or several selections as {1: mask, 2: other_mask}."
        )
    if not (labels > 0).any():
        raise InputError("The labels name no object: none is above 0.")
    return {int(number): labels == number for number in np.unique(labels[labels > 0])}


def _common_up(scene: Gaussians, selected: BoolArray, config: TrimConfig, cameras: CameraSet | None) -> KnownUp | None:
    """The up vector of the whole scene; None where each object must find the plane that it stands on."""
    up = find_up(scene, cameras, config.up, selected)
    return KnownUp(up, up_warning(scene, selected, up)) if up.source in KNOWN_SOURCES else None


def _claim(number: int, name: str, task: Task) -> _Claim:
    clock = Clock(lambda stage: None)
    decision = decide(task, clock)
    views = [view for view in decision.views if not view.rejected] or list(decision.views)
    decision = replace(
        decision,
        scope=replace(decision.scope, local=task.scene.select(np.zeros(0, np.int64))),
        views=tuple(without_pictures(view) for view in decision.views),
    )
    return _Claim(number, name, task, decision, clock, views[0] if views else None)


def share_out(scene: Gaussians, claims: Sequence[BoolArray], selections: Sequence[BoolArray]) -> tuple[IntArray, int]:
    """Place in the list of the object that gets each Gaussian, (N,), -1 for none, and how many were contested.

    Args:
        scene: all N Gaussians.
        claims: what each object asks for, (N,).
        selections: what was selected of each, (N,).
    """
    claimed = np.stack(claims)
    number = claimed.sum(axis=0)
    owner = np.where(number > 0, claimed.argmax(axis=0), _NOBODY)
    contested = np.flatnonzero(number > 1)
    if not len(contested):
        return owner, 0
    claims_here = claimed[:, contested]
    selected = claims_here & np.stack([selection[contested] for selection in selections])
    clear = selected.sum(axis=0) == 1
    owner[contested[clear]] = selected[:, clear].argmax(axis=0)
    unclear, settled = contested[~clear], np.flatnonzero(number == 1)
    if len(unclear) and len(settled):
        _, near = nearest(scene.means[settled], scene.means[unclear], min(_VOTING_NEIGHBOURS, len(settled)))
        voters = owner[settled[near]]
        votes = np.stack([(voters == place).sum(axis=1) for place in range(len(claims))])
        # Whoever claims it comes before whoever does not; of equal votes the first object wins.
        owner[unclear] = np.where(claims_here[:, ~clear], votes + 1, 0).argmax(axis=0)
    return owner, len(contested)


def _shared(claim: _Claim, ours: BoolArray) -> _Claim:
    """A claim without the Gaussians that other objects got; `ours` says which Gaussians of the scene it has, (N,)."""
    lost, decision = claim.members & ~ours, claim.decision
    if not lost.any():
        return claim
    parts = decision.parts.without(lost[decision.scope.rows]) if decision.parts else None
    return replace(claim, decision=replace(decision, parts=parts, given_up=lost))


def _finished(claim: _Claim) -> TrimResult:
    scope = claim.decision.scope
    scope = replace(scope, local=claim.task.scene.select(scope.rows))
    return finish(claim.task, replace(claim.decision, scope=scope), None, claim.clock)


def _outside_source(result: TrimResult) -> IntArray:
    return result.source_index[len(result.source_index) - len(result.outside_parts) :]


def _trimmed(claim: _Claim, result: TrimResult) -> TrimmedObject:
    n, given_up = len(result.object), claim.decision.given_up
    return TrimmedObject(
        id=claim.id,
        name=claim.name,
        gaussians=result.object,
        source_index=result.source_index[:n],
        label=result.label[:n],
        fitted=result.fitted,
        selection=claim.task.selection,
        bounds=result.bounds,
        view=claim.view,
        refused=result.refused,
        given_up=0 if given_up is None else int(given_up.sum()),
        report=result.report,
    )


def remove_all(scene: Gaussians, claims: Sequence[_Claim], owner: IntArray, renderer: Renderer, *, fill: bool) -> _Rest:
    """The scene without all objects. What they hid joins none of them, so that they do not depend on each other.

    Args:
        scene: all N Gaussians.
        claims: the objects, shared out.
        owner: place in the list of the object that has each Gaussian, -1 for none, (N,).
        renderer: draws the scene.
        fill: let the surfaces that objects stood on or leaned against go on where they hid them.
    """
    rest = _Rest.of(scene, owner == _NOBODY)
    filled, why_not = [rest.filled], []

    def without(place: int) -> tuple[IntArray, BoolArray, Removal]:
        own, bounds, config = owner == place, claims[place].decision.scope.bounds, claims[place].task.config
        distances = np.linalg.norm(scene.means - bounds.centre.astype(np.float32), axis=1)
        reach = max(config.context_radius, CONTEXT_RADIUS) * bounds.radius
        rows = np.flatnonzero(own | (distances < reach))
        removed = owner[rows] != _NOBODY
        cameras = views_of_place(bounds, config.refinement.size)
        at = Place(scene.select(rows), own[rows], removed, bounds, cameras, renderer)
        return rows, removed, remove(at, fill=fill)

    trimmed = [place for place, claim in enumerate(claims) if claim.decision.parts is not None and place in owner]
    for place, (rows, removed, removal) in zip(trimmed, parallel_map(without, trimmed, using=[renderer]), strict=True):
        claim = claims[place]
        rest.dropped[rows[(removal.ghosts | removal.replaced) & ~removed]] = True
        rest.gain[rows] = np.maximum(rest.gain[rows], removal.gain)
        filled.append(removal.filled)
        why_not += [f"{claim.name}: {removal.not_filled}"] if removal.not_filled else []
    return replace(rest, filled=concatenate(filled), not_filled=tuple(why_not))
