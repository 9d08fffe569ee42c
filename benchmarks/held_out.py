"""Choose settings of the trimmer by captures with ground truth, and see what they do on those that had no say.

    python benchmarks/held_out.py ROOT [ROOT ...] --settings evidence.min-in-place=0.6,0.8 label-crf.smoothness=3,5

Each ROOT holds benchmark scenes (see benchmark_scenes.py), or is one. Every selection is trimmed with the defaults and
with every value of every setting, one change at a time. For each group of captures, all other groups choose a value of
each setting; with these values together the selections of the group are trimmed once more. So the last table has scores
on which nothing that was chosen has looked. Captures that show the same objects belong to one group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

from benchmark_scenes import capture_of
from quality import add_trial_options, parser_of, trials

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.scoring import RULES, Judge
from gaussian_trimmer.evaluation.trials import Run, measure, way_of
from gaussian_trimmer.trimming.config import TrimConfig

Groups = Mapping[str, Mapping[str, float]]
"""Scores by group of captures and variant."""
DEFAULT = "default"


Choices = Mapping[str, Sequence[float]]
"""Settings, named as on the command line -> the values that they are chosen from."""


def main(words: Sequence[str] | None = None) -> None:
    parser = parser_of(__doc__)
    parser.add_argument("roots", nargs="+", type=Path, help="folders with benchmark scenes")
    parser.add_argument("--settings", nargs="+", required=True, help="what to choose, and values beside the default")
    add_trial_options(parser)
    options = vars(parser.parse_args(words))
    roots, choices = options.pop("roots"), dict(map(choice_of, options.pop("settings")))
    judge, found = Judge(), [trial for root in roots for trial in trials(root, **options)]
    configs = {DEFAULT: TrimConfig()}
    for setting, values in choices.items():
        configs |= variants_of(setting, values)
    ways = {name: way_of(config) for name, config in configs.items()}
    runs = [run for trial in found for run in measure(trial, ways, judge, fidelity=False)]
    groups = scores_by_group(runs)
    for setting, values in choices.items():
        print("\n".join(report(groups, [DEFAULT, *variants_of(setting, values)])), "\n")
    again = {group: {"held out": way_of(chosen_config(groups, choices, group))} for group in groups}
    runs = [run for run in runs if run.variant == DEFAULT]
    for trial in found:
        runs += measure(trial, again[capture_of(trial.scene)], judge, fidelity=False)
    print("\n".join(comparison(runs)))


def choice_of(text: str) -> tuple[str, tuple[float, ...]]:
    """A setting and its values from `name=value,value`; InputError if that is not what the text is."""
    name, _, listed = text.partition("=")
    try:
        return name, tuple(float(value) for value in listed.split(","))
    except ValueError as error:
        raise InputError(f"'{text}' is no choice; write it as evidence.min-in-place=0.6,0.7,0.8.") from error


def variants_of(setting: str, values: Sequence[float]) -> dict[str, TrimConfig]:
    """The settings with each value that is not the default, by name."""
    made = {f"{setting}={value:g}": changed(TrimConfig(), setting, value) for value in values}
    return {name: config for name, config in made.items() if config != TrimConfig()}


def changed(config: Any, setting: str, value: float) -> Any:
    """A configuration with one number changed, which is named as on the command line."""
    name, _, rest = setting.replace("-", "_").partition(".")
    if not hasattr(config, name):
        raise InputError(f"There is no setting '{name}'; 'gaussian-trimmer trim --help-all' lists them.")
    now = getattr(config, name)
    new = changed(now, rest, value) if rest else (int(value) if isinstance(now, int) else value)
    return replace(config, **{name: new})


def scores_by_group(runs: Sequence[Run]) -> dict[str, dict[str, float]]:
    """The mean of IoU alone and in scene by group and variant; each selection counts once."""
    groups: dict[str, dict[str, list[float]]] = {}
    for run in runs:
        score = fmean(run.after[f"iou{ending}"] for ending in RULES.values())
        groups.setdefault(capture_of(run.scene), {}).setdefault(run.variant, []).append(score)
    return {group: {name: fmean(scores) for name, scores in found.items()} for group, found in groups.items()}


def chosen(groups: Groups, names: Sequence[str], left_out: str = "") -> str:
    """The variant with the largest mean over groups, the first of equals; one group has no say."""
    having_a_say = [scores for group, scores in groups.items() if group != left_out]
    return max(names, key=lambda name: fmean(scores[name] for scores in having_a_say))


def chosen_config(groups: Groups, choices: Choices, left_out: str) -> TrimConfig:
    """The configuration that all other groups choose, each setting by itself."""
    config = TrimConfig()
    for setting, values in choices.items():
        name = chosen(groups, [DEFAULT, *variants_of(setting, values)], left_out)
        if name != DEFAULT:
            config = changed(config, setting, float(name.partition("=")[2]))
    return config


def report(groups: Groups, names: Sequence[str]) -> list[str]:
    """Lines of a table: group, score of each variant, and the one that the others choose with its score."""
    if len(groups) < 2:
        raise InputError("Only one group of captures: there is none that could be left out.")
    width = max(map(len, names)) + 2
    lines, held_out = [f"{'left out':24}" + "".join(f"{name:>{width}}" for name in names) + "  the others choose"], []
    for group, scores in groups.items():
        name = chosen(groups, names, group)
        held_out.append(scores[name])
        cells = "".join(f"{scores[other]:{width}.2f}" for other in names)
        lines.append(f"{group:24}{cells}  {name}: {scores[name]:.2f}")
    means = "".join(f"{fmean(scores[name] for scores in groups.values()):{width}.2f}" for name in names)
    lines.append(f"{'mean':24}{means}  held out {fmean(held_out):.2f}; all choose {chosen(groups, names)}")
    return lines


def comparison(runs: Sequence[Run]) -> list[str]:
    """Lines of a table: group, IoU by each rule of the input, with the defaults and held out, and trims that lose."""
    lines = [f"{'left out':24}{'trims':>6}" + "".join(f"{rule:>10}: input, default, held out" for rule in RULES)]
    groups = {capture_of(run.scene): None for run in runs}
    for name in [*groups, "all"]:
        of_group = [run for run in runs if name in (capture_of(run.scene), "all")]
        final = [run for run in of_group if run.variant == DEFAULT]
        held_out = [run for run in of_group if run.variant != DEFAULT]
        line = f"{name:24}{len(final):6}"
        for ending in RULES.values():
            metric = f"iou{ending}"
            means = (
                fmean(r.before[metric] for r in final),
                *(fmean(r.after[metric] for r in s) for s in (final, held_out)),
            )
            line += "".join(f"{mean:9.2f}" for mean in means)
            line += f"  lose {sum(r.loses(metric) for r in final)}, {sum(r.loses(metric) for r in held_out)}"
        lines.append(line)
    return lines


if __name__ == "__main__":
    main()
