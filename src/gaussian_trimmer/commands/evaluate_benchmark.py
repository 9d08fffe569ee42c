"""`gaussian-trimmer evaluate benchmark`: how good are the trims? Before and after, against ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.tables import Findings, TableOptions, publish, results_folder
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.benchmark import (
    BenchmarkOptions,
    benchmark_tasks,
    table_of_kinds,
    table_of_scenes,
)
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.evaluation.runs import Run, measure
from gaussian_trimmer.evaluation.scoring import Occlusion, Shown
from gaussian_trimmer.evaluation.sheets import comparison_sheet
from gaussian_trimmer.evaluation.variants import chosen_variants
from gaussian_trimmer.output.pictures import Picture
from gaussian_trimmer.settings import check_settings


@dataclass(frozen=True)
class Benchmark:
    """Trim every rough selection of benchmark scenes, and compare with ground truth before and after.

    The trimmer gets the scene, the selection, the training cameras and, where the scene states one, the up vector. A
    selection with fewer than a tenth of the Gaussians that the kind `exact` has is left out, and said to be.
    """

    root: Annotated[Positional[Path], arg(metavar="ROOT")]
    """Folder with benchmark scenes, or one scene; the repository has some in benchmarks/data."""
    variants: tuple[str, ...] = ("default",)
    """Ways of running the trimmer, side by side; `ablations` stands for all that need no trained model."""
    sam_model: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder with a model of the SAM family, for variants with `sam` in their names."""
    fidelity: bool = True
    """Also compare object and background together with the untouched scene."""
    occlusion: Occlusion = "alone"
    """Render the object alone, or measure its share of the whole scene's picture."""
    quiet: bool = False
    """Print nothing but errors."""
    options: Annotated[BenchmarkOptions, arg(name="")] = field(default_factory=BenchmarkOptions)
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        """Measure, print a line for each trim and the tables, and write them if asked to.

        Raises:
            InputError: something that the user gave cannot be used, or there is nothing to measure.
        """
        console = open_console(quiet=self.quiet)
        # Lines on every trim would be no part of a CSV, JSON or LaTeX.
        progress = open_console(quiet=self.quiet or self.tables.format != "table")
        check_settings(self.rules)
        with results_folder(self.tables) as folder:
            publish(self._measure(progress), self.tables, console, folder)

    def _measure(self, progress: Console) -> Findings:
        chosen, (judge,) = chosen_variants(self.variants, self.sam_model), self.rules.judge(self.occlusion)
        runs: list[Run] = []
        pictures: dict[str, Picture] = {}

        def keep_sheet(run: Run, views: Sequence[TestView], before: Sequence[Shown], after: Sequence[Shown]) -> None:
            if self.tables.output is not None:
                name = f"sheets/{run.variant}/{run.scene}_{run.object}_{run.kind}.png"
                pictures[name] = comparison_sheet(views, before, after, self.rules.threshold)

        for task in benchmark_tasks(self.root, self.options, lambda what: progress.print(f"left out: {what}")):
            for run in measure(task, chosen, [judge], fidelity=self.fidelity, show=keep_sheet):
                runs.append(run)
                print_run(run, progress)
        if not runs:
            raise InputError(f"Nothing to measure in '{self.root}': no scene there has such objects and selections.")
        tables = {}
        for variant in chosen:
            of_variant, notes = [run for run in runs if run.variant == variant], [judge.describe()]
            tables[f"{variant}-kinds"] = table_of_kinds(variant, of_variant, notes)
            tables[f"{variant}-scenes"] = table_of_scenes(variant, of_variant, notes)
        return Findings(tables, pictures, figures=[run.as_dict() for run in runs])


def print_run(run: Run, console: Console) -> None:
    """A line on one trim."""
    changes = "  ".join(
        f"{name} {run.before[name]:5.1f} -> {run.after[name]:5.1f}"
        for name in ("iou", "boundary_iou", "psnr")
        if name in run.before
    )
    kept = "" if np.isnan(run.fidelity) else f"fidelity {run.fidelity:4.1f}  "
    tail = f"{run.seconds:4.1f} s{'  LOSS' if run.loses else ''} {run.refused}".rstrip()
    console.print(
        f"{run.variant:18s} {run.kind:12s} {run.scene}/{run.object:12s} {run.occlusion:8s} {changes}  {kept}{tail}"
    )
