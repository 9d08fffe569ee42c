"""`gaussian-trimmer evaluate nvos` and the other data sets: methods before and after trimming."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import Findings, RuleOptions, TableOptions, publish
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.clip_iqa import PAIRS
from gaussian_trimmer.evaluation.datasets import LAYOUTS, MEAN_NOTES, OWN, Layout, Protocol
from gaussian_trimmer.evaluation.metrics import THRESHOLD
from gaussian_trimmer.evaluation.scoring import METRICS, RULES, Judge, Scores, mean_scores
from gaussian_trimmer.evaluation.tables import (
    MADE_BY,
    Cell,
    ScoreTable,
    heading,
    score_cells,
    table_of_statistics,
    unit_scores,
)
from gaussian_trimmer.evaluation.trials import Run, find_files, measure, read_ids, trials_of, way_of
from gaussian_trimmer.options import Names, Positional, arg
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings, to_plain
from gaussian_trimmer.trimming.config import TrimConfig, paper_config


@dataclass(frozen=True)
class _EvaluateDataset:
    layout: ClassVar[str]
    root: Annotated[Positional[Path], arg(metavar="ROOT")]
    """Folder of the data set."""
    predictions: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")]
    """Output folders of segmentation methods, one or several; a method is called like its folder."""
    protocol: str = OWN
    """Rules of the comparison: this program's, or those of a published code, which docs/evaluation.md lists."""
    tasks: tuple[str, ...] = ()
    """Only these tasks."""
    scenes: str | None = None
    """Pattern of the splat files below a folder of predictions, in which {scene} and {object} stand for the task's
    names; without it the usual places are searched."""
    selections: str | None = None
    """Pattern of the selections or objects; without it the usual places are searched."""
    cameras: str | None = None
    """Pattern of the cameras; without it the usual places are searched, also in the data set."""
    ids: Annotated[Path | None, arg(metavar="FILE")] = None
    """CSV file with the id of each task's object, or several: rows of task and ids, such as 'ramen/yellow bowl,12 45'.
    The tasks of a scene may then share a selection file."""
    preset: Literal["default", "paper"] = "default"
    """Defaults of the trimmer's settings: those of this program, or those of the GaussianTrimmer paper."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How selection files are read; the defaults suffice unless a file can be understood in several ways."""
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    @classmethod
    def presets(cls, given: Mapping[Names, Any]) -> dict[Names, Any]:
        """Return the values that a preset has for fields; options given beside it come on top."""
        return {("config",): paper_config()} if given.get(("preset",)) == "paper" else {}

    def run(self) -> None:
        """Trim every prediction, measure before and after, print the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used; everything is looked for before the first trim.
        """
        check_settings(self.config)
        check_settings(self.selection_options, "selection")
        publish(self._measure, **vars(self.tables))

    def _measure(self) -> Findings:
        layout, judge = LAYOUTS[self.layout], self.rules.judge()
        protocol = layout.protocol(self.protocol)
        if self.protocol != OWN:
            if self.rules.threshold not in (THRESHOLD, protocol.threshold):
                raise InputError(
                    f"The protocol '{self.protocol}' has the threshold {protocol.threshold:g}; leave it out."
                )
            judge = replace(judge, threshold=protocol.threshold)
        methods = self._runs(layout, protocol, judge)
        rules = [judge.describe()] if self.protocol == OWN else [protocol.describe()]
        notes = [*rules, f"trimmed with the preset '{self.preset}', {self.config.plan.views} views", MADE_BY]
        notes.append(MEAN_NOTES[layout.mean_over])
        n_tasks = min(map(len, methods.values()))
        if n_tasks != layout.expected and layout.expected is not None:
            notes.append(
                f"{n_tasks} tasks, where {layout.title} has {layout.expected}: means are not comparable with published "
                "ones"
            )
        tables = {f"{self.layout}-{name}": table_of_tasks(layout, name, runs, notes) for name, runs in methods.items()}
        metrics = {rule: [name + RULES[rule] for name in ("iou", layout.second)] for rule in protocol.rules}
        tables[self.layout] = table_of_means(layout, methods, metrics, notes)
        if self.rules.clip:
            tables[f"{self.layout}-clip"] = table_of_means(layout, methods, {"CLIP-IQA": list(PAIRS)}, notes)
        title, listed = f"{layout.title}: how sure the means are", [name for own in metrics.values() for name in own]
        tables[f"{self.layout}-statistics"] = table_of_statistics(title, methods, listed, notes, layout.mean_over)
        settings = {"protocol": self.protocol, "preset": self.preset}
        parts = {"config": self.config, "rules": self.rules, "selection_options": self.selection_options}
        found = [run for runs in methods.values() for run in runs]
        return tables, found, settings | {name: to_plain(part) for name, part in parts.items()}

    def _runs(self, layout: Layout, protocol: Protocol, judge: Judge) -> dict[str, list[Run]]:
        """Return the runs of every method."""
        tasks = layout.find_tasks(self.root, self.tasks)
        folders = {folder.resolve().name: folder for folder in self.predictions}
        if not folders or len(folders) < len(self.predictions):
            names = ", ".join(folder.name for folder in self.predictions) or "none"
            raise InputError(f"Give folders with different names after --predictions; given: {names}.")
        ids = read_ids(self.ids, tasks) if self.ids else {}
        patterns = {"scene": self.scenes, "selection": self.selections, "cameras": self.cameras}
        found = {
            name: [find_files(task, folder, self.root, patterns, bool(ids)) for task in tasks]
            for name, folder in folders.items()
        }
        way = {str(self.preset): way_of(self.config, paper=self.preset == "paper")}
        # Lines on the progress belong to no CSV or JSON.
        progress = open_console(quiet=self.tables.quiet or self.tables.json or self.tables.format != "table")
        methods: dict[str, list[Run]] = {name: [] for name in found}
        for name, files in found.items():
            for trial in trials_of(tasks, files, name, self.selection_options, protocol, ids):
                for run in measure(trial, way, judge, fidelity=False):
                    methods[name].append(run)
                    progress.print(str(run))
        return methods


@dataclass(frozen=True)
class Nvos(_EvaluateDataset):
    """Measure methods on NVOS before and after trimming.

    ROOT holds masks/<task>/<target>_mask.png. In a method's folder each task has its files in <task>/ or <scene>/:
    scene.ply or point_cloud/iteration_*/point_cloud.ply, a selection or object file, and cameras; or name the files
    with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "nvos"


@dataclass(frozen=True)
class LerfMask(_EvaluateDataset):
    """Measure methods on LERF-Mask before and after trimming.

    ROOT holds <scene>/test_mask/<view>/<words>.png with <scene>/images and <scene>/images_train. In a method's folder
    each object has its files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "lerf-mask"


@dataclass(frozen=True)
class LerfOvs(_EvaluateDataset):
    """Measure methods on LERF-OVS before and after trimming.

    ROOT holds label/<scene>/<picture>.json with polygons, and <scene>/images. In a method's folder each object has its
    files in <scene>/<words>/ or <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "lerf-ovs"


def table_of_tasks(layout: Layout, method: str, runs: Sequence[Run], notes: Sequence[str]) -> ScoreTable:
    """Return a row for each task of one method, and the mean as the data set takes it."""
    metrics = ["iou", "accuracy", "boundary_iou", *(["acc25"] if layout.second == "acc25" else [])]
    names = [name + ending for ending in RULES.values() for name in metrics]
    rows: list[list[Cell]] = []
    for run in runs:
        label = run.object if run.object.startswith(run.scene) else f"{run.scene}/{run.object}"
        rows.append([label, run.views, *score_cells(names, run.before, run.after)])
    if layout.mean_over != "objects":
        scenes = unit_scores(runs, layout.mean_over)
        rows += [[f"{scene}, mean", None, *score_cells(names, *pair)] for scene, pair in scenes.items()]
    rows.append(["mean", None, *score_cells(names, *_mean_of(layout, runs))])
    columns = ["task", "views", *(f"{METRICS[name]} {rule} (%)" for rule in RULES for name in metrics)]
    return ScoreTable(f"{layout.title}: {method} before -> after trimming", columns, rows, notes)


def table_of_means(
    layout: Layout, methods: Mapping[str, Sequence[Run]], metrics: Mapping[str, Sequence[str]], notes: Sequence[str]
) -> ScoreTable:
    """Return means of the methods, a row for each rule and method, with the metrics that a rule has."""
    rows: list[list[Cell]] = [
        [method, rule, *score_cells(names, *_mean_of(layout, runs))]
        for method, runs in methods.items()
        for rule, names in metrics.items()
    ]
    columns = ["method", "rule", *map(heading, next(iter(metrics.values())))]
    return ScoreTable(f"{layout.title} with and without trimming", columns, rows, notes, digits=1)


def _mean_of(layout: Layout, runs: Sequence[Run]) -> tuple[Scores, Scores]:
    """Return scores before and after, averaged as the data set does."""
    units = unit_scores(runs, layout.mean_over).values()
    return mean_scores(before for before, _ in units), mean_scores(after for _, after in units)
