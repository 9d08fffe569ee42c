"""`gaussian-trimmer evaluate nvos`, `lerf-mask` and `spin-nerf`: methods before and after trimming."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from tyro.conf import Positional, arg

from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.tables import Findings, TableOptions, print_run
from gaussian_trimmer.config import TrimConfig, check_config
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.dataset_tables import table_beside_published, table_of_looks, table_of_tasks
from gaussian_trimmer.evaluation.dataset_tasks import chosen_tasks, dataset_tasks, find_predictions
from gaussian_trimmer.evaluation.layouts import LAYOUTS
from gaussian_trimmer.evaluation.predictions import PredictionPatterns
from gaussian_trimmer.evaluation.runs import Run, Variant, measure
from gaussian_trimmer.evaluation.scoring import Judge
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, SEGMENTERS, segmenter_with
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings
from gaussian_trimmer.trimming.options import SegmenterOptions


@dataclass(frozen=True)
class _EvaluateDataset:
    layout: ClassVar[str]
    root: Annotated[Positional[Path], arg(metavar="ROOT")]
    """Folder of the data set."""
    predictions: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]")]
    """Output folders of segmentation methods, one or several; a method is called like its folder."""
    tasks: tuple[str, ...] = ()
    """Only these tasks."""
    patterns: Annotated[PredictionPatterns, arg(name="")] = field(default_factory=PredictionPatterns)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How selection files are read; the defaults suffice unless a file can be understood in several ways."""
    preset: Literal["default", "paper"] = "default"
    """Defaults of the trimmer's settings: those of this program, or those of the GaussianTrimmer paper."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """What segments the object in the views."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    segmenter_options: Annotated[Any, arg(name="")] = field(default_factory=SegmenterOptions)
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Trim every prediction, measure before and after, print the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used; everything is looked for before the first trim.
        """
        check_config(self.config)
        check_settings(self.segmenter_options)
        check_settings(self.selection_options, "selection")
        self.tables.publish(self._measure, open_console(quiet=self.quiet))

    def _measure(self) -> Findings:
        layout, judge = LAYOUTS[self.layout], self.rules.judge()
        methods = self._runs(judge)
        views = self.config.plan.views
        notes = [judge.describe(), f"trimmed with the preset '{self.preset}', {views} views, {self.segmenter}"]
        tables = {f"{self.layout}-{name}": table_of_tasks(layout, name, runs, notes) for name, runs in methods.items()}
        tables[self.layout] = table_beside_published(layout, methods, notes)
        if self.rules.clip:
            tables[f"{self.layout}-clip"] = table_of_looks(layout, methods, notes)
        return Findings(tables, [run for runs in methods.values() for run in runs])

    def _runs(self, judge: Judge) -> dict[str, list[Run]]:
        """The runs of every method."""
        tasks = chosen_tasks(LAYOUTS[self.layout], self.root, self.tasks)
        names = method_names(self.predictions)
        found = [find_predictions(tasks, folder, self.patterns, self.root) for folder in self.predictions]
        variant: dict[str, Variant] = {
            self.preset: Variant(self.config, segmenter_with(self.segmenter, self.segmenter_options))
        }
        # Lines on the progress belong to no CSV or JSON.
        progress = open_console(quiet=self.quiet or self.tables.format != "table")
        methods: dict[str, list[Run]] = {}
        for name, predictions in zip(names, found, strict=True):
            methods[name] = []
            for task in dataset_tasks(tasks, predictions, name, self.selection_options):
                (run,) = measure(task, variant, judge, fidelity=False)
                methods[name].append(run)
                print_run(run, progress)
        return methods


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
