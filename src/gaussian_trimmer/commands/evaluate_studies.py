"""`gaussian-trimmer evaluate ablation`, `view-counts` and `sheets`: the studies and figures of the paper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training, training_cameras
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.evaluate_benchmark import print_run
from gaussian_trimmer.commands.evaluate_dataset import method_names
from gaussian_trimmer.commands.tables import Findings, TableOptions, publish, results_folder
from gaussian_trimmer.commands.trimmer_options import TrimmerOptions
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.benchmark import BenchmarkOptions, benchmark_tasks
from gaussian_trimmer.evaluation.captures import Capture, find_capture
from gaussian_trimmer.evaluation.dataset_tasks import chosen_tasks, dataset_tasks, find_predictions
from gaussian_trimmer.evaluation.layouts import get_layout
from gaussian_trimmer.evaluation.plots import Curve, two_curves
from gaussian_trimmer.evaluation.predictions import PredictionPatterns
from gaussian_trimmer.evaluation.results import read_result
from gaussian_trimmer.evaluation.runs import Run, Task, run_variant
from gaussian_trimmer.evaluation.scoring import Cut, Occlusion
from gaussian_trimmer.evaluation.sheets import capture_sheet
from gaussian_trimmer.evaluation.studies import (
    ablation_table,
    measure_all,
    view_count_points,
    view_counts_table,
)
from gaussian_trimmer.evaluation.variants import Variant, with_view_counts, without_planning_or_background
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.pictures import Picture, write_picture
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES, get_renderer
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import check_settings

_LATENCY, _GAIN = "#c2410c", "#1d4ed8"


@dataclass(frozen=True)
class StudyData:
    """What a study is made on."""

    root: Annotated[Positional[Path], arg(metavar="ROOT")]
    """Folder with benchmark scenes, or of a published data set; the repository has scenes in benchmarks/data."""
    layout: Literal["benchmark", "nvos", "lerf-mask", "spin-nerf"] = "benchmark"
    """What ROOT is."""
    predictions: Annotated[Path | None, arg(metavar="DIR")] = None
    """Output folder of the method whose selections are trimmed, for a published data set."""
    tasks: tuple[str, ...] = ()
    """Only these tasks of a published data set."""
    benchmark: Annotated[BenchmarkOptions, arg(name="")] = field(default_factory=BenchmarkOptions)
    patterns: Annotated[PredictionPatterns, arg(name="")] = field(default_factory=PredictionPatterns)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How selection files are read; the defaults suffice unless a file can be understood in several ways."""

    def read(self, console: Console) -> Iterator[Task]:
        """The tasks, read one by one; what is missing is found before the first.

        Raises:
            InputError: the data cannot be used.
        """
        if (self.layout == "benchmark") != (self.predictions is None):
            raise InputError("Published data sets, and they alone, need a method's output: --predictions DIR.")
        if self.predictions is None:
            return benchmark_tasks(self.root, self.benchmark, lambda what: console.print(f"left out: {what}"))
        tasks = chosen_tasks(get_layout(self.layout), self.root, self.tasks)
        found = find_predictions(tasks, self.predictions, self.patterns, self.root)
        return dataset_tasks(tasks, found, method_names([self.predictions])[0], self.selection_options)


@dataclass(frozen=True)
class _Study(TrimmerOptions):
    data: Annotated[StudyData, arg(name="")] = field(kw_only=True)
    occlusion: Occlusion = "alone"
    """Render the object alone, or measure its share of the whole scene's picture."""
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Measure, print the table, and write it if asked to; errors as those of the other commands."""
        check_settings(self.rules)
        console = open_console(quiet=self.quiet)
        with results_folder(self.tables) as folder:
            publish(self._study(), self.tables, console, folder)

    def _study(self) -> Findings:
        raise NotImplementedError

    def _measure(self, variants: Mapping[str, Variant]) -> tuple[list[Run], list[str]]:
        """All runs, and notes on how they were made.

        Raises:
            InputError: something that the user gave cannot be used, or there is nothing to measure.
        """
        progress = open_console(quiet=self.quiet or self.tables.format != "table")
        (judge,) = self.rules.judge(self.occlusion)
        runs = measure_all(self.data.read(progress), variants, judge, lambda run: print_run(run, progress))
        if not runs:
            raise InputError(f"Nothing to measure in '{self.data.root}': it has no such objects and selections.")
        return runs, [judge.describe(), f"trimmed with the preset '{self.preset}' and the segmenter {self.segmenter}"]


@dataclass(frozen=True)
class Ablation(_Study):
    """Measure what virtual camera planning and background augmentation bring, as the paper's table of ablations does.

    Without planning, five training cameras are looked from, so the data must have some.
    """

    def _study(self) -> Findings:
        variants = without_planning_or_background(self.variant())
        runs, notes = self._measure(variants)
        table = ablation_table(runs, list(variants), notes)
        return Findings({"ablation": table}, figures=[run.as_dict() for run in runs])


@dataclass(frozen=True)
class ViewCounts(_Study):
    """Measure gain and latency with 1, 2, 3, 5, 7 and 10 virtual views, and plot both.

    Each task is first trimmed once without being measured, since that compiles and fills caches.
    """

    def _study(self) -> Findings:
        by_count = with_view_counts(self.variant())
        warm_up = {"warm-up": by_count[1]}
        variants = {f"{n} views": variant for n, variant in by_count.items()}
        runs, notes = self._measure(warm_up | variants)
        runs = [run for run in runs if run.variant not in warm_up]
        counts = dict(zip(variants, by_count, strict=True))
        points = view_count_points(runs, counts)
        latency = Curve("latency (ms)", [point[1] for point in points], _LATENCY)
        gain = Curve("gain in mIoU (points)", [point[2] for point in points], _GAIN)
        plot = two_curves("Number of virtual views", "views", [point[0] for point in points], latency, gain)
        table = view_counts_table(runs, counts, notes)
        figures = [run.as_dict() for run in runs]
        return Findings({"view-counts": table}, texts={"view-counts.svg": plot}, figures=figures)


@dataclass(frozen=True)
class Sheets(TrimmerOptions):
    """Draw qualitative sheets: photograph, selection and trim, for captures without ground truth.

    A capture is a folder with cameras and photographs as mip-NeRF 360, Instruct-NeRF2NeRF, PKU-DyMVHumans and COLMAP
    have them, a splat file (scene.ply or point_cloud/iteration_*/point_cloud.ply) and a selection (selection.npy or
    another ending); or name the files with --scenes, --selections and --cameras.
    """

    captures: Annotated[Positional[tuple[Path, ...]], arg(metavar="FOLDER [FOLDER ...]")] = ()
    """Folders of captures."""
    output: Annotated[Path, arg(metavar="DIR")] = Path("sheets")
    """Folder for the sheets, one for each capture."""
    overwrite: bool = False
    """Replace earlier sheets in the output folder."""
    rows: Annotated[int, arg(metavar="INT")] = 4
    """Photographs on a sheet."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views."""
    patterns: Annotated[PredictionPatterns, arg(name="")] = field(default_factory=PredictionPatterns)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How selection files are read; the defaults suffice unless a file can be understood in several ways."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> None:
        """Trim every capture and draw its sheet.

        Raises:
            InputError: a capture cannot be used; what is missing is found before the first trim.
        """
        console = open_console(quiet=self.quiet)
        names = method_names(self.captures)
        if not 1 <= self.rows <= 100:
            raise InputError(f"--rows is {self.rows}; it must be a whole number from 1 to 100.")
        check_settings(self.selection_options, "selection")
        found = [find_capture(folder, self.patterns) for folder in self.captures]
        variant = self.variant()
        with atomic_folder(self.output, "evaluate sheets", overwrite=self.overwrite) as folder:
            for name, capture in zip(names, found, strict=True):
                write_picture(self._draw(capture, variant), folder / f"{name}.png")
                console.print(f"{self.output / name}.png")

    def _draw(self, capture: Capture, variant: Variant) -> Picture:
        scene = formats.read(capture.scene)
        listed = read_camera_set(capture.cameras)
        stored = read_result(capture.selection, scene, self.selection_options)
        if stored.selection is None:
            raise InputError(f"The trimmer cannot start from '{capture.selection}': {stored.unknown_background}")
        renderer, given = get_renderer(self.renderer), only_training(listed)
        task = Task(capture.name, capture.name, "capture", scene, stored.selection, stored.cut, (), given)
        result = run_variant(task, variant, renderer)
        cut = Cut(result.object, result.background)
        cameras = training_cameras(listed)
        return capture_sheet(cameras, capture.images, stored.cut, cut, result.bounds, renderer, self.rows)
