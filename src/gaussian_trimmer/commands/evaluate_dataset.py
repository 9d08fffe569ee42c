"""`gaussian-trimmer evaluate nvos`, `lerf-mask` and `spin-nerf`: a method's output folder before and after trims."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.evaluate_benchmark import print_run
from gaussian_trimmer.commands.tables import Findings, TableOptions, publish, results_folder
from gaussian_trimmer.commands.trimmer_options import TrimmerOptions
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.dataset_tasks import (
    chosen_tasks,
    dataset_tasks,
    find_predictions,
    table_beside_published,
    table_of_looks,
    table_of_tasks,
)
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.layouts import get_layout
from gaussian_trimmer.evaluation.predictions import PredictionPatterns
from gaussian_trimmer.evaluation.runs import Run, measure
from gaussian_trimmer.evaluation.scoring import Shown
from gaussian_trimmer.evaluation.sheets import comparison_sheet
from gaussian_trimmer.output.pictures import Picture
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings


@dataclass(frozen=True)
class DatasetOptions:
    """A published data set and what methods made of it."""

    root: Annotated[Positional[Path], arg(metavar="ROOT")]
    """Folder of the data set."""
    predictions: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")]
    """Output folders of segmentation methods, one or several; a method is called like its folder."""
    tasks: tuple[str, ...] = ()
    """Only these tasks."""
    patterns: Annotated[PredictionPatterns, arg(name="")] = field(default_factory=PredictionPatterns)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How selection files are read; the defaults suffice unless a file can be understood in several ways."""


@dataclass(frozen=True)
class _EvaluateDataset(TrimmerOptions):
    layout: ClassVar[str]
    data: Annotated[DatasetOptions, arg(name="")] = field(kw_only=True)
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Trim every prediction, measure before and after, print the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used; everything is looked for before the first trim.
        """
        console = open_console(quiet=self.quiet)
        progress = open_console(quiet=self.quiet or self.tables.format != "table")
        check_settings(self.rules)
        check_settings(self.data.selection_options, "selection")
        with results_folder(self.tables) as folder:
            publish(self._measure(progress), self.tables, console, folder)

    def _measure(self, progress: Console) -> Findings:
        layout, variant = get_layout(self.layout), self.variant()
        tasks = chosen_tasks(layout, self.data.root, self.data.tasks)
        names = method_names(self.data.predictions)
        found = {
            name: find_predictions(tasks, folder, self.data.patterns, self.data.root)
            for name, folder in zip(names, self.data.predictions, strict=True)
        }
        judges = self.rules.judge("alone", "in-scene")
        runs: dict[str, list[Run]] = {name: [] for name in names}
        pictures: dict[str, Picture] = {}

        def keep_sheet(run: Run, views: Sequence[TestView], before: Sequence[Shown], after: Sequence[Shown]) -> None:
            if self.tables.output is not None:
                name = f"sheets/{run.kind}/{run.scene}_{run.object}_{run.occlusion}.png"
                pictures[name] = comparison_sheet(views, before, after, self.rules.threshold)

        for name, predictions in found.items():
            for task in dataset_tasks(tasks, predictions, name, self.data.selection_options):
                for run in measure(task, {self.preset: variant}, judges, fidelity=False, show=keep_sheet):
                    runs[name].append(run)
                    print_run(run, progress)
        rule = judges[1].describe().split("; ")
        occlusion = "alone: the object rendered by itself; in scene: its share of the whole (occlusion counts)"
        notes = [f"{rule[0]}; {rule[-1]}; {occlusion}"]
        notes.append(f"trimmed with the preset '{self.preset}', {self.config.plan.views} views, {self.segmenter}")
        tables = {
            f"{self.layout}-{name}": table_of_tasks(layout, name, "trimming", of_method, notes)
            for name, of_method in runs.items()
        }
        tables[self.layout] = table_beside_published(layout, dict(runs), notes)
        if self.rules.clip:
            tables[f"{self.layout}-clip"] = table_of_looks(layout, dict(runs), [judges[0].describe(), notes[-1]])
        figures = [run.as_dict() for of_method in runs.values() for run in of_method]
        return Findings(tables, pictures, figures=figures)


@dataclass(frozen=True)
class Nvos(_EvaluateDataset):
    """Measure methods on NVOS before and after trimming, beside the published figures.

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
class SpinNerf(_EvaluateDataset):
    """Measure methods on SPIn-NeRF's masks before and after trimming, beside the published figures.

    ROOT holds <scene>/<picture>.png or <scene>/masks/<picture>.png. In a method's folder each scene has its files in
    <scene>/; or name them with --scenes, --selections and --cameras.
    """

    layout: ClassVar[str] = "spin-nerf"


def method_names(folders: Sequence[Path]) -> list[str]:
    """The names of methods: those of their folders.

    Raises:
        InputError: no folder is given, or two have the same name.
    """
    names = [folder.resolve().name for folder in folders]
    if not names or len(set(names)) < len(names):
        raise InputError(f"Give folders of predictions with different names; given: {', '.join(names) or 'none'}.")
    return names
