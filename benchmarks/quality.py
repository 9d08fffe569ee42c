"""How good are the trims? Every scene x object x kind of rough selection, before and after, against ground truth.

    python benchmarks/quality.py [ROOT] [--variants default no-recover paper ...] [--without-cameras] [--output DIR]

ROOT holds benchmark scenes (see benchmark_scenes.py), or is one; without it, those that come with the repository are
measured. Every table has both rules of occlusion: the object alone, and its share of the whole scene. Where there are
several variants, the last table has what each lacks of the first one.

The trimmer gets the scene, the selection, the training cameras and, where the scene has one, the up vector. A selection
with fewer than a tenth of the Gaussians that the kind `exact` has is left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_scenes import BenchmarkScene, capture_of, find_scenes, open_scene
from variants import chosen_variants

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import only_training, up_frame
from gaussian_trimmer.commands.evaluate import Findings, publish
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.scoring import METRICS, RULES, Judge, cut_by, mean_scores
from gaussian_trimmer.evaluation.tables import (
    MADE_BY,
    Cell,
    ScoreTable,
    heading,
    interval_of,
    known_metrics,
    score_cells,
    table_of_statistics,
    unit_scores,
)
from gaussian_trimmer.evaluation.trials import LOSS, Run, Trial, measure
from gaussian_trimmer.gaussians import BoolArray

DATA = Path(__file__).parent / "data"
SMALLEST_SELECTION = 0.1
"""Selections with a smaller share of the Gaussians of `exact` are left out: nobody would start from them."""
BOX_MARGIN = 0.1
"""Width that the kind `box` adds around an object, in radii."""


def trials(
    root: Path,
    objects: Sequence[str] = (),
    kinds: Sequence[str] = (),
    without_cameras: bool = False,
    all_views: bool = False,
    report: Callable[[str], None] = print,
) -> Iterator[Trial]:
    """Yield the trials of all scenes at or in a folder; `report` is told which selections are left out."""
    for folder in find_scenes(root):
        scene = open_scene(folder)
        cameras = None if without_cameras else only_training(read_camera_set(scene.cameras_file))
        up = None if scene.up is None or without_cameras else tuple(scene.up.tolist())
        for name in scene.objects:
            if objects and name not in objects:
                continue
            views = [view for view in scene.test_views(name) if all_views or not view.far]
            for kind in kinds or scene.coarse_kinds(name):
                selection = box_around(scene, name) if kind == "box" else scene.coarse(name, kind)
                if too_small(scene, name, kind, selection):
                    report(f"left out: {scene.name}/{name} {kind}, {selection.sum()} Gaussians")
                    continue
                before = cut_by(scene.gaussians, selection)
                yield Trial(scene.name, name, kind, scene.gaussians, before, views, cameras, up)


def parser_of(text: str) -> argparse.ArgumentParser:
    """A parser that describes itself by the documentation of a script."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)


def add_trial_options(parser: argparse.ArgumentParser) -> None:
    """Options that `trials` has."""
    parser.add_argument("--objects", nargs="+", default=(), help="only these objects")
    parser.add_argument("--kinds", nargs="+", default=(), help="only these kinds of rough selection; box is a box "
                        "around the object, wider by a tenth of its radius")  # fmt: skip
    parser.add_argument("--without-cameras", action="store_true", help="give neither cameras nor up vector")
    parser.add_argument("--all-views", action="store_true", help="count far test views as well")


def main(words: Sequence[str] | None = None) -> None:
    parser = parser_of(__doc__)
    parser.add_argument("root", nargs="?", type=Path, default=DATA, help="folder with benchmark scenes, or one scene")
    parser.add_argument("--variants", nargs="+", default=["default"], help="side by side; see variants.py")
    parser.add_argument("--sam-model", type=Path, help="folder of a model, for variants with sam in their names")
    parser.add_argument("--output", type=Path, help="folder to write all tables to, in every format")
    add_trial_options(parser)
    options = parser.parse_args(words)
    publish(lambda: quality(**vars(options)), output=options.output)


def quality(
    root: Path, variants: Sequence[str], sam_model: Path | None, output: Path | None, **chosen: Any
) -> Findings:
    """Trim every rough selection in every way."""
    ways, judge = chosen_variants(variants, sam_model), Judge()
    runs: list[Run] = []
    for trial in trials(root, **chosen):
        for run in measure(trial, ways, judge):
            runs.append(run)
            print(run, flush=True)
    if not runs:
        raise InputError(f"Nothing to measure in '{root}': no scene there has such objects and selections.")
    by_variant = {name: [run for run in runs if run.variant == name] for name in ways}
    tables, notes = {}, [judge.describe(), MADE_BY]
    for variant, own in by_variant.items():
        for name in ("kind", "scene"):
            tables[f"{variant}-{name}s"] = table_of(f"{variant}, by {name}", grouped(own, name), notes)
    metrics = [metric + ending for ending in RULES.values() for metric in ("iou", "accuracy", "boundary_iou")]
    title = "how sure the means over objects are"
    tables["statistics"] = table_of_statistics(title, by_variant, metrics, notes, capture_of=capture_of)
    if len(by_variant) > 1:
        tables["worth"] = worth_table(by_variant, notes)
    return tables, runs, {}


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
    loss = f"a loss is more than {LOSS:g} points of IoU; s: median of a trim"
    return ScoreTable(title, columns, rows, [*notes, loss])


def worth_table(variants: Mapping[str, Sequence[Run]], notes: Sequence[str]) -> ScoreTable:
    """A row for each variant but the first: scores of the first less its own, means over objects with intervals."""
    (full, first), *others = variants.items()
    best, metrics = unit_scores(first, "objects"), known_metrics(*(run.after for run in first))
    rows: list[list[Cell]] = []
    for name, runs in others:
        scores = unit_scores(runs, "objects")
        pairs = [(best[unit][1], after) for unit, (_, after) in scores.items()]
        captures = [capture_of(unit.partition("/")[0]) for unit in scores]
        worth = [interval_of([whole[metric] - part[metric] for whole, part in pairs], captures) for metric in metrics]
        rows.append([name, len(pairs), *worth])
    about = f"scores after trimming, of '{full}' less those of the row; means over objects, 95 % intervals by captures"
    columns = ["", "objects", *(METRICS[name] for name in metrics)]
    return ScoreTable(f"what '{full}' is worth", columns, rows, [about, *notes])


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
    main()
