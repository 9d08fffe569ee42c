"""What do the parts of the method bring? The paper's ablations, by the tool's own rules or by the paper's.

    python benchmarks/ablations.py [ROOT] [--tables parts views splits] [--rules paper] [--sam-model DIR] [--output DIR]
    python benchmarks/ablations.py NVOS --layout nvos --predictions results/SAGA --rules paper

ROOT holds benchmark scenes, as those of quality.py, or is the folder of a published data set. Every table says whose
rules it is by; the paper's figures, which are of SAGA on NVOS, stand only beside figures by the paper's rules.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from quality import DATA, TrialOptions, table_of
from tyro.conf import Positional, arg
from variants import VIEW_COUNTS, chosen_variants

from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.tables import Findings, TableOptions, print_run
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.dataset_tasks import chosen_tasks, trials_of
from gaussian_trimmer.evaluation.layouts import LAYOUTS
from gaussian_trimmer.evaluation.predictions import PredictionPatterns, find_predictions
from gaussian_trimmer.evaluation.runs import Run, Trial, Variant, measure, unit_scores
from gaussian_trimmer.evaluation.scoring import METRICS
from gaussian_trimmer.evaluation.statistics import interval_of
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable
from gaussian_trimmer.masks.sam import SamSegmenter
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.trimming.config import TrimConfig

Rules = Literal["own", "paper"]
Table = Literal["parts", "views", "splits", "stages"]
TABLES: dict[Table, dict[str, str]] = {
    "parts": {
        "-no-virtual-cameras": "No VCP",
        "-no-background": "No background augmentation",
        "-neither": "No VCP and BA",
        "": "Full GaussianTrimmer",
    },
    "views": {f"-views-{n}": f"{n} views" for n in VIEW_COUNTS},
    "stages": {
        "": "default",
        "-no-label-crf": "labels as given",
        "-no-plane-rule": "no support plane",
        "-no-colour-model": "no colour model",
        "-no-interior-trust": "no trust from the boundary inwards",
        "-no-vote": "no vote of the views",
        "-no-recover": "nothing recovered",
        "-no-in-place": "nothing that the scene hides pruned",
        "-no-cuts": "fitted without cuts",
        "-no-steps": "cut and not fitted",
        "-no-fit": "neither cut nor fitted",
        "-no-filling": "background not filled",
        "-no-removal": "background as it was",
    },
    "splits": {
        "-principal-axis-split": "along the principal axis, eqs. 8 and 9",
        "-sagd-split": "SAGD's single child",
        "-plane-split": "by the plane of the outline",
        "-no-split": "none",
    },
}
"""Endings of variants, and what they are called in the tables."""
TITLES: dict[Table, str] = {
    "parts": "Virtual camera planning (VCP) and background augmentation (BA)",
    "views": "Number of virtual views",
    "splits": "Splitting rule",
    "stages": "Stages of the default",
}
WORTH = ("iou", "iou_in_scene", "soft_iou", "boundary_iou", "psnr")
"""Scores by which it is judged what a part is worth."""
WHOSE: dict[Rules, str] = {"own": "by the tool's own rules", "paper": "by the paper's rules"}
PUBLISHED: dict[Table, tuple[tuple[str, str], dict[str, tuple[float, float]]]] = {
    "parts": (
        ("paper: mIoU (%)", "paper: mAcc (%)"),
        {
            "No VCP": (91.3, 98.3),
            "No background augmentation": (91.5, 98.4),
            "No VCP and BA": (91.3, 98.3),
            "Full GaussianTrimmer": (92.1, 98.5),
        },
    ),
    "views": (
        ("paper: mIoU gain", "paper: s"),
        {
            "1 views": (0.8, 0.256),
            "2 views": (0.9, 0.409),
            "3 views": (1.0, 0.521),
            "5 views": (1.2, 0.766),
            "7 views": (1.2, 1.037),
            "10 views": (1.2, 1.566),
        },
    ),
}
"""Headings and figures of the paper: SAGA on NVOS, 90.9 and 98.3 before trimming, with SAM2 on a GPU."""


@dataclass(frozen=True)
class Ablations:
    """Measure trims without parts of the method, with other numbers of views, and with other splitting rules."""

    root: Annotated[Positional[Path], arg(metavar="ROOT")] = DATA
    """Folder with benchmark scenes, or of a published data set."""
    tables: tuple[Table, ...] = ("parts", "views", "splits")
    """Which tables."""
    rules: Rules = "own"
    """Whose settings are ablated: the tool's own, or the paper's."""
    sam_model: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder with a model of the SAM family that segments the views."""
    layout: Literal["benchmark", "nvos", "lerf-mask", "spin-nerf"] = "benchmark"
    """What ROOT is."""
    predictions: Annotated[Path | None, arg(metavar="DIR")] = None
    """Output folder of the method whose selections are trimmed, for a published data set."""
    tasks: tuple[str, ...] = ()
    """Only these tasks of a published data set."""
    pixels: int = TrimConfig().plan.size
    """Width of the virtual views."""
    times: bool = False
    """Let SAM encode the views of every trim anew; otherwise trims of one object share them, and seconds mislead."""
    options: Annotated[TrialOptions, arg(name="")] = field(default_factory=TrialOptions)
    judging: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    output: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        self.output.publish(self._measure, open_console(quiet=False))

    def _measure(self) -> Findings:
        judge, progress = self.judging.judge(), open_console(quiet=self.output.format != "table")
        variants, runs = self._variants(), []
        for trial in self._trials():
            # A first trim that is not measured compiles and fills caches.
            next(iter(variants.values())).trim(trial)
            for run in measure(trial, variants, judge, fidelity=False):
                runs.append(run)
                print_run(run, progress)
                segmenter = variants[run.variant].segmenter
                if self.times and isinstance(segmenter, SamSegmenter):
                    segmenter.forget()
        if not runs:
            raise InputError(f"Nothing to measure in '{self.root}': it has no such objects and selections.")
        tables: dict[str, ScoreTable] = {}
        for name in self.tables:
            groups = self._groups(name, runs)
            tables[name] = ablation_table(name, self.rules, groups, [judge.describe()])
            if full := TABLES[name].get(""):
                tables[f"{name}-worth"] = worth_table(f"{TITLES[name]}, {WHOSE[self.rules]}", full, groups)
        return Findings(tables, runs)

    def _variants(self) -> dict[str, Variant]:
        names = [self._name(ending) for table in self.tables for ending in TABLES[table]]
        chosen = chosen_variants(tuple(dict.fromkeys(names)), self.sam_model)
        return {
            name: replace(v, config=replace(v.config, plan=replace(v.config.plan, size=self.pixels)))
            for name, v in chosen.items()
        }

    def _name(self, ending: str) -> str:
        """The variant of an ending: `default` and those without a prefix are the tool's own."""
        base = "-".join([*(["paper"] if self.rules == "paper" else []), *(["sam"] if self.sam_model else [])])
        return base + ending if base else ending.removeprefix("-") or "default"

    def _groups(self, table: Table, runs: Sequence[Run]) -> dict[str, Sequence[Run]]:
        return {
            label: [run for run in runs if run.variant == self._name(ending)] for ending, label in TABLES[table].items()
        }

    def _trials(self) -> Iterator[Trial]:
        if (self.layout == "benchmark") != (self.predictions is None):
            raise InputError("Published data sets, and they alone, need a method's output: --predictions DIR.")
        if self.predictions is None:
            return self.options.trials(self.root)
        tasks = chosen_tasks(LAYOUTS[self.layout], self.root, self.tasks)
        found = find_predictions(tasks, self.predictions, PredictionPatterns(), self.root)
        return trials_of(tasks, found, self.predictions.resolve().name, SelectionOptions())


def ablation_table(name: Table, rules: Rules, groups: Mapping[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """A row for each variant; beside it the paper's figures, if there are any and the rules are the paper's."""
    table = table_of(f"{TITLES[name]}, {WHOSE[rules]}", groups, [*notes, f"trimmed {WHOSE[rules]}"])
    if rules != "paper" or name not in PUBLISHED:
        return table
    headings, figures = PUBLISHED[name]
    rows: list[list[Cell]] = [[*row, *figures[str(row[0])]] for row in table.rows]
    source = "the paper's columns are of SAGA on NVOS, with SAM2 on a GPU"
    return replace(table, columns=[*table.columns, *headings], rows=rows, notes=[*table.notes, source])


def worth_table(title: str, full: str, groups: Mapping[str, Sequence[Run]]) -> ScoreTable:
    """A row for each part: scores of the full method less those without it, means over objects with 95 % intervals."""
    best = unit_scores(groups[full], "objects")
    rows: list[list[Cell]] = []
    for label, runs in groups.items():
        pairs = [(best[unit][1], after) for unit, (_, after) in unit_scores(runs, "objects").items()]
        worth = [[whole[name] - part[name] for whole, part in pairs if name in part] for name in WORTH]
        if label != full:
            rows.append([label, len(pairs), *(interval_of(values) if values else None for values in worth)])
    notes = ["scores after trimming, of the full method less those of the row; means over objects, 95 % intervals"]
    columns = ["without", "objects", *(METRICS[name] for name in WORTH)]
    return ScoreTable(f"{title}: what each part is worth", columns, rows, notes)


if __name__ == "__main__":
    tyro.cli(Ablations).run()
