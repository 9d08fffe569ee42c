"""Learn which regions that touch are one thing, and say how well that does on captures that it was not learned from.

    python benchmarks/joining.py SCENE[,SCENE ...] [SCENE[,SCENE ...] ...]

Each SCENE is a benchmark scene (see benchmark_scenes.py); those joined by commas share objects and are left out
together. Each is taken as it is, and with each pair of its objects put against each other as benchmarks/touching.py
does. Regions are joined as the truth has it, the likeliest first; what is learned from are the contacts that are joined
and those of two things that are met on the way. Then the same is done with what was learned, since other contacts are
met then. Printed are, for each group, the contacts that are judged wrong, the objects found and false, and the pairs
found apart, all by weights from the other groups; and last the weights of all, as `surface/contacts.py` has them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benchmark_scenes import BenchmarkScene, open_scene
from touching import FOUND, touching_pairs

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training
from gaussian_trimmer.finding.found import SURE
from gaussian_trimmer.finding.judging import FindConfig, judge
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians, IntArray
from gaussian_trimmer.surface import contacts as known
from gaussian_trimmer.surface.contacts import Contacts
from gaussian_trimmer.surface.regions import find_regions
from gaussian_trimmer.surface.room_surfaces import Room, find_room
from gaussian_trimmer.surface.visible_surface import VisibleSurface, find_visible_surface, views_of
from gaussian_trimmer.trimming.up_vector import find_up

_ROUNDS = 3
_PURE = 0.85
"""Share of a region that must be of one object, so that it is known what it is."""
_SEVERAL = ("books",)
"""Objects that are several things in truth: where their parts meet says nothing."""
_COST_OF_PIECES = 2.0
"""Weight of contacts within things: that one falls apart is worse than that two are found as one."""
_ENOUGH = 15
"""Number of contacts of a scene from which on it counts as much as the others."""
_RIDGE, _NEWTON_STEPS = 1e-3, 30

Weights = tuple[Float64Array, float]


@dataclass(eq=False)
class _Case:
    """One scene, as it is or with two of its objects against each other."""

    group: int
    scene: str
    surface: VisibleSurface
    room: Room
    objects: list[str]
    labels: IntArray
    """Number of the object, from 1, that each Gaussian of the surface is of, 0 for none, (S,)."""
    pair: tuple[str, str] | None
    met: dict[tuple[float, ...], tuple[bool, str]] = field(default_factory=dict)
    """Measures of contacts, whether each is within a thing, and the scene's name."""


def main() -> None:
    """Print what is learned and how well it does."""
    groups = [[Path(root) for root in listed.split(",")] for listed in sys.argv[1:]]
    cases = [case for group, roots in enumerate(groups) for root in roots for case in _cases(group, open_scene(root))]
    weights: Weights = np.array(known.WEIGHTS), known.INTERCEPT
    for _ in range(_ROUNDS):
        for case in cases:
            find_regions(case.surface, case.room, _taught(case, weights))
        weights = _learned(cases)
    for group, roots in enumerate(groups):
        held_out = _learned([case for case in cases if case.group != group])
        own = [case for case in cases if case.group == group]
        print(",".join(root.name for root in roots), _tested(own, held_out), flush=True)
    print("WEIGHTS =", tuple(weights[0].round(2).tolist()), "INTERCEPT =", round(weights[1], 2))


def _cases(group: int, scene: BenchmarkScene) -> Iterator[_Case]:
    cameras = only_training(read_camera_set(scene.cameras_file))
    up = np.asarray(find_up(scene.gaussians, cameras, None).direction, np.float64)
    names = scene.objects

    def case(gaussians: Gaussians, masks: dict[str, BoolArray], pair: tuple[str, str] | None) -> _Case:
        surface = find_visible_surface(gaussians, views_of(gaussians, cameras, up), up)
        labels = np.zeros(len(surface.rows), np.int64)
        for number, name in enumerate(names, 1):
            labels[masks[name][surface.rows]] = number
        return _Case(group, scene.name, surface, find_room(surface), names, labels, pair)

    exact = {name: scene.coarse(name, "exact") for name in names}
    yield case(scene.gaussians, exact, None)
    for pair, gaussians, masks in touching_pairs(scene, up):
        yield case(gaussians, {**exact, **dict(zip(pair, masks, strict=True))}, pair)


def _taught(case: _Case, weights: Weights) -> Callable[[Contacts], Float64Array]:
    """Joins what is one thing, the likeliest first by some weights, and notes what is met."""
    several = [case.objects.index(name) + 1 for name in _SEVERAL if name in case.objects]

    def odds(contacts: Contacts) -> Float64Array:
        count = int(contacts.regions.max()) + 1
        shares = np.zeros((count, len(case.objects) + 1))
        np.add.at(shares, (contacts.regions, case.labels), case.surface.areas)
        of, pure = shares.argmax(axis=1), shares.max(axis=1) > _PURE * shares.sum(axis=1)
        first, second = of[contacts.pairs].T
        same = first == second
        counts = pure[contacts.pairs].all(axis=1) & ((first > 0) | (second > 0)) & ~(same & np.isin(first, several))
        likely = np.where(same, np.exp(np.clip(contacts.measures @ weights[0] + weights[1], -30, 30)), 0.0)
        best = np.zeros(count)
        for end in contacts.pairs.T:
            np.maximum.at(best, end, likely)
        joined = same & (likely >= best[contacts.pairs].max(axis=1))
        for place in np.flatnonzero(counts & (joined | ~same)):
            measures = tuple(contacts.measures[place].round(3).tolist())
            case.met[measures] = bool(same[place]), case.scene
        return np.asarray(likely)

    return odds


def _learned(cases: list[_Case]) -> Weights:
    """Weights of a logistic regression over all contacts that were met, where each scene counts the same."""
    met = {measures: truth for case in cases for measures, truth in case.met.items()}
    measures, within = np.array(list(met)), np.array([same for same, _ in met.values()])
    scenes, counts = np.array([scene for _, scene in met.values()]), np.zeros(len(met))
    for scene in set(scenes.tolist()):
        for same in (False, True):
            own = (scenes == scene) & (within == same)
            share = min(1.0, own.sum() / _ENOUGH) / max(own.sum(), 1)
            counts[own] = share * (_COST_OF_PIECES if same else 1.0)
    middle, scale = measures.mean(axis=0), measures.std(axis=0)
    table = np.column_stack([(measures - middle) / scale, np.ones(len(measures))])
    ridge, found = np.diag([*[_RIDGE * counts.sum()] * len(scale), 0.0]), np.zeros(len(scale) + 1)
    for _ in range(_NEWTON_STEPS):
        likely = 1 / (1 + np.exp(-np.clip(table @ found, -30, 30)))
        curvature = (table * (counts * likely * (1 - likely))[:, None]).T @ table + ridge
        found = found - np.linalg.solve(curvature, table.T @ (counts * (likely - within)) + ridge @ found)
    return found[:-1] / scale, float(found[-1] - (found[:-1] * middle / scale).sum())


def _tested(cases: list[_Case], weights: Weights) -> str:
    """How well some weights do."""
    met = {measures: same for case in cases for measures, (same, _) in case.met.items()}
    joined = np.array(list(met)) @ weights[0] + weights[1] > 0
    within = np.array(list(met.values()))
    found, objects, false, apart = 0, 0, 0, []
    for case in cases:
        best, without = _found(case, weights)
        if case.pair is None:
            found, objects, false = found + sum(iou > FOUND for iou, _ in best), objects + len(best), false + without
        else:
            (first, one), (second, other) = (best[case.objects.index(name)] for name in case.pair)
            apart.append(min(first, second) > FOUND and one != other)
    return (
        f"refused {np.count_nonzero(within & ~joined)} of {np.count_nonzero(within)}, "
        f"joined {np.count_nonzero(joined & ~within)} of {np.count_nonzero(~within)}, "
        f"found {found} of {objects}, false {false}, pairs apart {sum(apart)} of {len(apart)}"
    )


def _found(case: _Case, weights: Weights) -> tuple[list[tuple[float, int]], int]:
    """For each object the largest IoU with a sure region and its number, and how many of these are no object."""
    surface = case.surface
    (regions,) = find_regions(surface, case.room, lambda contacts: contacts.measures @ weights[0] + weights[1])
    sure = [
        one.region for one in judge(surface, case.room, regions, FindConfig()) if one.confidence >= SURE
    ]  # no surfaces of the room are among these
    pixels = surface.shown.sum(axis=0)
    ious = np.zeros((len(case.objects), len(sure) + 1))
    for row in range(len(case.objects)):
        part = case.labels == row + 1
        for column, region in enumerate(sure, 1):
            own = regions == region
            ious[row, column] = pixels[part & own].sum() / pixels[part | own].sum()
    best = [(float(row.max()), int(row.argmax())) for row in ious]
    return best, int((ious[:, 1:].max(axis=0, initial=0.0) < 0.5).sum())


if __name__ == "__main__":
    main()
