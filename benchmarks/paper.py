"""The paper's tables with trained models: its gain, its ablations, its numbers of views, its splitting rule.

    python benchmarks/paper.py MODELS ROOT [--scenes tabletop ...] [--kinds dilated ...] [--tables gain ...]

MODELS holds one folder for each model, as `--sam.model` takes them; ROOT holds benchmark scenes. Tables are written as
Markdown. Gains are points of foreground IoU and pixel accuracy in held-out views over the selection as it came in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.console import Console

from gaussian_trimmer.evaluation.benchmark import BenchmarkOptions, benchmark_tasks
from gaussian_trimmer.evaluation.runs import Run, measure
from gaussian_trimmer.evaluation.scoring import Judge
from gaussian_trimmer.evaluation.variants import chosen_variants
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters.sam import SamSegmenter

Table = Literal["gain", "ablations", "views", "splits"]
TABLES: dict[Table, dict[str, str]] = {
    "gain": {
        "paper-sam": "the paper's rules",
        "paper-sam-close": "the paper's rules at our framing",
        "sam": "our rules",
        "default": "our rules without SAM",
    },
    "ablations": {
        "paper-sam-no-virtual-cameras": "no VCP: five training views",
        "paper-sam-no-background": "no background augmentation",
        "paper-sam-neither": "neither",
        "paper-sam": "all of it",
    },
    "views": {f"paper-sam-views-{n}": f"n = {n}" for n in (1, 2, 3, 5, 7, 10)},
    "splits": {
        "paper-sam": "along the principal axis, eqs. 8 and 9",
        "paper-sam-sagd-split": "SAGD's single child",
        "paper-sam-plane-split": "by the plane of the outline",
        "paper-sam-no-split": "none",
    },
}
"""Variants of the benchmark, and what they are called in the tables."""


@dataclass(frozen=True)
class Arguments:
    """Measure the paper's rules with trained models."""

    models: tyro.conf.Positional[Path]
    """Folder of models, or one model."""
    root: tyro.conf.Positional[Path]
    """Folder with benchmark scenes, or one scene."""
    scenes: tuple[str, ...] = ("scene0", "tabletop", "flower", "sparse")
    """Only these scenes of the folder."""
    objects: tuple[str, ...] = ()
    """Only these objects."""
    kinds: tuple[str, ...] = ("dilated",)
    """Only these kinds of coarse selection."""
    tables: tuple[Table, ...] = ("gain", "ablations", "views", "splits")
    """Which tables."""
    times: bool = False
    """Let every trim encode its views anew and tell its seconds. Else those of one object share what is encoded."""


def main() -> None:
    """Run all variants of the tables and print these."""
    arguments = tyro.cli(Arguments)
    console = Console(width=200)
    for model in find_models(arguments.models):
        rows = _measure(model, arguments, console)
        for table in arguments.tables:
            text = markdown(TABLES[table], rows, arguments.times)
            console.print(f"\n{model.name}, {table}\n{text}", markup=False, highlight=False)


def find_models(folder: Path) -> list[Path]:
    """The folder, if it has an encoder, or those in it that have one."""
    folders = [folder, *sorted(path for path in folder.iterdir() if path.is_dir())]
    return [path for path in folders if any("encoder" in file.name for file in path.glob("*.o*"))]


def markdown(names: dict[str, str], rows: Sequence[Run], times: bool) -> str:
    """One line for each variant: IoU before and after, gain in IoU and accuracy, worst trim, perhaps median seconds."""
    heads = ["", "trims", "IoU", "gain in IoU", "in accuracy", "worst", "losses", *(["s a trim"] if times else [])]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for variant, name in names.items():
        chosen = [row for row in rows if row.variant == variant]
        if not chosen:
            continue
        gains = {m: np.mean([row.after[m] - row.before[m] for row in chosen]) for m in ("iou", "accuracy")}
        before, after = (np.mean([getattr(row, side)["iou"] for row in chosen]) for side in ("before", "after"))
        worst = min(chosen, key=lambda row: row.iou_change)
        seconds = f" {np.median([row.seconds for row in chosen]):.1f} |" if times else ""
        lines.append(
            f"| {name} | {len(chosen)} | {before:.2f} -> {after:.2f} | {gains['iou']:+.2f} | {gains['accuracy']:+.2f} "
            f"| {worst.iou_change:+.2f} {worst.scene}/{worst.object} | {sum(row.loses for row in chosen)} |{seconds}"
        )
    return "\n".join(lines)


def _measure(model: Path, arguments: Arguments, console: Console) -> list[Run]:
    names = tuple(dict.fromkeys(variant for table in arguments.tables for variant in TABLES[table]))
    chosen = chosen_variants(names, model)
    options, judge = BenchmarkOptions(arguments.objects, arguments.kinds), Judge(get_renderer("numba"))
    runs = []
    for task in benchmark_tasks(arguments.root, options):
        if task.scene in arguments.scenes:
            for run in measure(task, chosen, [judge], fidelity=False):
                console.print(f"{model.name} {run.variant} {run.scene}/{run.object} {run.kind} {run.iou_change:+.2f}")
                runs.append(run)
                segmenter = chosen[run.variant].segmenter
                if arguments.times and isinstance(segmenter, SamSegmenter):
                    segmenter.forget()  # before the next variant is run
    return runs


if __name__ == "__main__":
    main()
