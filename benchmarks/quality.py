"""How good are the trims? Every scene x object x kind of rough selection, before and after, against ground truth.

    python benchmarks/quality.py [ROOT] [--variants default paper sagd-split ...] [--without-cameras] [--output DIR]

ROOT holds benchmark scenes (see benchmark_scenes.py), or is one; without it, those that come with the repository are
measured. Every table has both rules of occlusion: the object alone, and its share of the whole scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from benchmark_scenes import BenchmarkScene, find_scenes, open_scene
from tyro.conf import Positional, arg
from variants import chosen_variants

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training, up_frame
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.evaluate import RuleOptions
from gaussian_trimmer.commands.tables import Findings, TableOptions, print_run
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.provenance import made_by
from gaussian_trimmer.evaluation.results import cut_by
from gaussian_trimmer.evaluation.runs import LOSS, Run, Trial, measure
from gaussian_trimmer.evaluation.scoring import RULES, mean_scores
from gaussian_trimmer.evaluation.statistics import table_of_statistics
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable, heading, known_metrics, score_cells
from gaussian_trimmer.gaussians import BoolArray

DATA = Path(__file__).parent / "data"
SMALLEST_SELECTION = 0.1
"""Selections with a smaller share of the Gaussians of `exact` are left out: nobody would start from them."""
BOX_MARGIN = 0.1
"""Width that the kind `box` adds around an object, in radii."""


@dataclass(frozen=True)
class TrialOptions:
    """Which trims are measured."""

    objects: tuple[str, ...] = ()
    """Only these objects."""
    kinds: tuple[str, ...] = ()
    """Only these kinds of rough selection; `box` is a box around the object, wider by a tenth of its radius."""
    without_cameras: bool = False
    """Give the trimmer neither cameras nor up vector."""
    all_views: bool = False
    """Count far test views as well."""

    def trials(self, root: Path, report: Callable[[str], None] = lambda text: None) -> Iterator[Trial]:
        """Yield the trials of all scenes at or in a folder; `report` is told which selections are left out."""
        for folder in find_scenes(root):
            scene = open_scene(folder)
            for name in scene.objects:
                if not self.objects or name in self.objects:
                    yield from self._trials_of(scene, name, report)

    def _trials_of(self, scene: BenchmarkScene, name: str, report: Callable[[str], None]) -> Iterator[Trial]:
        cameras = None if self.without_cameras else only_training(read_camera_set(scene.cameras_file))
        up = None if scene.up is None or self.without_cameras else tuple(scene.up.tolist())
        views = [view for view in scene.test_views(name) if self.all_views or not view.far]
        for kind in self.kinds or scene.coarse_kinds(name):
            selection = box_around(scene, name) if kind == "box" else scene.coarse(name, kind)
            if too_small(scene, name, kind, selection):
                report(f"left out: {scene.name}/{name} {kind}, {selection.sum()} Gaussians")
                continue
            before = cut_by(scene.gaussians, selection)
            yield Trial(scene.name, name, kind, scene.gaussians, selection, before, views, cameras, up)


@dataclass(frozen=True)
class Quality:
    """Trim every rough selection of benchmark scenes, and compare with ground truth before and after.

    The trimmer gets the scene, the selection, the training cameras and, where the scene has one, the up vector. A
    selection with fewer than a tenth of the Gaussians that the kind `exact` has is left out.
    """

    root: Annotated[Positional[Path], arg(metavar="ROOT")] = DATA
    """Folder with benchmark scenes, or one scene."""
    variants: tuple[str, ...] = ("default",)
    """Ways of running the trimmer, side by side; see variants.py."""
    sam_model: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder with a model of the SAM family, for variants with `sam` in their names."""
    fidelity: bool = True
    """Also compare object and background together with the untouched scene."""
    options: Annotated[TrialOptions, arg(name="")] = field(default_factory=TrialOptions)
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)

    def run(self) -> None:
        self.tables.publish(self._measure, open_console(quiet=False))

    def _measure(self) -> Findings:
        progress = open_console(quiet=self.tables.format != "table")
        chosen, judge = chosen_variants(self.variants, self.sam_model), self.rules.judge()
        runs: list[Run] = []
        for trial in self.options.trials(self.root, progress.print):
            for run in measure(trial, chosen, judge, fidelity=self.fidelity):
                runs.append(run)
                print_run(run, progress)
        if not runs:
            raise InputError(f"Nothing to measure in '{self.root}': no scene there has such objects and selections.")
        tables = {}
        for variant in chosen:
            of_variant = [run for run in runs if run.variant == variant]
            for name in ("kind", "scene"):
                groups = grouped(of_variant, name)
                tables[f"{variant}-{name}s"] = table_of(f"{variant}, by {name}", groups, [judge.describe()])
        by_variant = {name: [run for run in runs if run.variant == name] for name in chosen}
        metrics = [metric + ending for ending in RULES.values() for metric in ("iou", "accuracy", "boundary_iou")]
        title, notes = "how sure the means over objects are", [judge.describe(), made_by()]
        tables["statistics"] = table_of_statistics(title, by_variant, metrics, notes)
        return Findings(tables, runs)


def grouped(runs: Sequence[Run], attribute: str) -> dict[str, Sequence[Run]]:
    """The runs by one of their attributes, and all of them."""
    names = sorted({getattr(run, attribute) for run in runs})
    return {**{name: [run for run in runs if getattr(run, attribute) == name] for name in names}, "all": runs}


def table_of(title: str, groups: Mapping[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """Means of groups of runs; by each rule of occlusion how many trims lose, and which one loses most."""
    metrics = known_metrics(*(run.after for runs in groups.values() for run in runs))
    rows: list[list[Cell]] = []
    for name, runs in groups.items():
        before, after = mean_scores(run.before for run in runs), mean_scores(run.after for run in runs)
        row: list[Cell] = [name, len(runs), *score_cells(metrics, before, after)]
        for ending in RULES.values():
            worst = min(runs, key=lambda run, metric=f"iou{ending}": run.gain(metric))  # type: ignore[misc]
            row.append(sum(run.loses(f"iou{ending}") for run in runs))
            row.append(f"{worst.gain(f'iou{ending}'):+.2f} {worst.scene}/{worst.object} {worst.kind}")
        rows.append([*row, sum(bool(run.refused) for run in runs), float(np.median([run.seconds for run in runs]))])
    by_rule = [f"{what} {rule}" for rule in RULES for what in ("losses", "worst IoU change")]
    columns = ["", "trims", *map(heading, metrics), *by_rule, "refused", "s"]
    return ScoreTable(
        title, columns, rows, [*notes, f"a loss is more than {LOSS:g} points of IoU; s: median of a trim"]
    )


def too_small(scene: BenchmarkScene, name: str, kind: str, selection: BoolArray) -> bool:
    """Whether the selection holds less than a tenth of what the kind `exact` holds."""
    if kind == "exact" or "exact" not in scene.coarse_kinds(name):
        return False
    return bool(selection.sum() < SMALLEST_SELECTION * scene.coarse(name, "exact").sum())


def box_around(scene: BenchmarkScene, name: str) -> BoolArray:
    """What an upright box around the object holds: percentiles 1 to 99 of its centres, and a margin in radii."""
    axes = up_frame(scene.up if scene.up is not None else np.array([0.0, -1.0, 0.0]))
    positions = scene.gaussians.means @ axes.T
    low, high = np.percentile(positions[scene.coarse(name, "exact")], [1, 99], axis=0)
    reach = BOX_MARGIN * np.linalg.norm(high - low) / 2
    return np.asarray(((positions > low - reach) & (positions < high + reach)).all(axis=1))


if __name__ == "__main__":
    tyro.cli(Quality).run()
