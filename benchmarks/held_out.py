"""Choose a setting of the trimmer by captures with ground truth, and see what it does on those that had no say.

    python benchmarks/held_out.py ROOT [ROOT ...] --setting evidence.min-in-place --values 0.6 0.65 0.7 0.75

Each ROOT holds benchmark scenes (see benchmark_scenes.py), or is one. Every selection is trimmed with every value. For
each group of captures the value is chosen by all other groups, and its score on this group is the held-out one; the
last line has the value that all of them choose. Captures that show the same objects belong to one group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

import tyro
from quality import TaskOptions
from tyro.conf import Positional, arg

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.runs import Run, Variant, measure
from gaussian_trimmer.evaluation.scoring import Judge
from gaussian_trimmer.rendering import get_renderer

SAME_OBJECTS = (("scene0", "sparse"), ("tabletop", "parts", "flat"))
"""Scenes of the benchmark that share objects; a capture's name may go on, as in "scene0_haze"."""


@dataclass(frozen=True)
class HeldOut:
    """Choose one number by leaving each group of captures out in turn."""

    roots: Annotated[Positional[tuple[Path, ...]], arg(metavar="ROOT")]
    """Folders with benchmark scenes."""
    setting: str
    """What to choose, as on the command line: `evidence.min-in-place`."""
    values: tuple[float, ...]
    """The values to choose from."""
    options: Annotated[TaskOptions, arg(name="")] = field(default_factory=TaskOptions)

    def run(self) -> None:
        if not self.values:
            raise InputError("There is nothing to choose from: give --values.")
        variants = {str(value): Variant(changed(TrimConfig(), self.setting, value)) for value in self.values}
        judge, runs = Judge(get_renderer("numba")), list[Run]()
        for root in self.roots:
            for task in self.options.tasks(root, print):
                runs += measure(task, variants, judge, fidelity=False)
                print(
                    task.scene, task.object, task.kind, *(f"{run.after['iou']:.1f}" for run in runs[-len(variants) :])
                )
        print("\n".join(report(scores_by_group(runs), [str(value) for value in self.values])))


def changed(config: Any, setting: str, value: float) -> Any:
    """A configuration with one number changed, which is named as on the command line."""
    name, _, rest = setting.replace("-", "_").partition(".")
    if not hasattr(config, name):
        raise InputError(f"There is no setting '{name}'; 'gaussian-trimmer trim --help-all' lists them.")
    return replace(config, **{name: changed(getattr(config, name), rest, value) if rest else value})


def group_of(scene: str) -> str:
    """The group of captures that a scene belongs to."""
    for names in SAME_OBJECTS:
        if scene.startswith(names):
            return "+".join(names)
    return scene.removesuffix("_small")


def scores_by_group(runs: Sequence[Run]) -> dict[str, dict[str, float]]:
    """The mean of IoU alone and in scene by group and variant; each selection counts once."""
    groups: dict[str, dict[str, list[float]]] = {}
    for run in runs:
        score = (run.after["iou"] + run.after["iou_in_scene"]) / 2
        groups.setdefault(group_of(run.scene), {}).setdefault(run.variant, []).append(score)
    return {group: {name: fmean(scores) for name, scores in found.items()} for group, found in groups.items()}


def chosen(groups: Mapping[str, Mapping[str, float]], values: Sequence[str], left_out: str = "") -> str:
    """The value with the largest mean over groups, the first of equals; one group has no say."""
    having_a_say = [scores for group, scores in groups.items() if group != left_out]
    return max(values, key=lambda value: fmean(scores[value] for scores in having_a_say))


def report(groups: Mapping[str, Mapping[str, float]], values: Sequence[str]) -> list[str]:
    """Lines of a table: group, score with each value, the value that the others choose, and the score with it."""
    if len(groups) < 2:
        raise InputError("Only one group of captures: there is none that could be left out.")
    lines, held_out = [f"{'left out':24}" + "".join(f"{value:>8}" for value in values) + "  the others choose"], []
    for group, scores in groups.items():
        value = chosen(groups, values, group)
        held_out.append(scores[value])
        cells = "".join(f"{scores[other]:8.2f}" for other in values)
        lines.append(f"{group:24}{cells}  {value}: {scores[value]:.2f}")
    means = "".join(f"{fmean(scores[value] for scores in groups.values()):8.2f}" for value in values)
    lines.append(f"{'mean':24}{means}  held out {fmean(held_out):.2f}; all choose {chosen(groups, values)}")
    return lines


if __name__ == "__main__":
    tyro.cli(HeldOut).run()
