"""How good are the trims? Every scene x object x kind of coarse selection, before and after, against ground truth.

    python benchmarks/quality.py ROOT [--variants default paper sagd ...] [--without-cameras] [--output DIR]
    python benchmarks/quality.py ROOT --variants default sam paper-sam --sam-model DIR

ROOT holds benchmark scenes (see `gaussian_trimmer.evaluation.datasets`), for example `benchmarks/data`. No ground
truth reaches the trimmer: it gets the scene, the coarse selection and, where the scene has them, the up vector and the
training cameras.

A selection with fewer than a tenth of the Gaussians that the kind `exact` has is left out, and said to be: nobody
would start from it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.decomposition.contact import SupportPlaneSplitConfig
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.datasets import BenchmarkScene, TestView, find_scenes, open_scene
from gaussian_trimmer.gaussians import BoolArray, Gaussians, concatenate
from gaussian_trimmer.geometry.bounds import up_frame
from gaussian_trimmer.pipeline import RowLabel, SplitConfig, TrimConfig, TrimResult, paper_config, trim
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, PAPER_SEGMENTER, Segmenter, get_segmenter
from gaussian_trimmer.segmentation.segmenters.sam import SamConfig, paper_sam

_HIGHEST_PSNR = 100.0  # dB; a view that does not show the object would have an infinite one.
_LOSS = 0.3
"""Points of foreground IoU; a trim that loses more has done harm."""
_SMALLEST_SELECTION = 0.1
"""Share of the Gaussians of `exact`; selections with fewer are left out."""
METRICS = ("iou", "accuracy", "boundary_iou", "soft_iou", "psnr")
Scores = dict[str, float]


@dataclass(frozen=True)
class Variant:
    """One way of running the trimmer."""

    config: TrimConfig = field(default_factory=TrimConfig)
    segmenter: str = DEFAULT_SEGMENTER
    training_views: int = 0
    """Use this many training cameras instead of virtual ones."""
    sam: SamConfig = field(default_factory=SamConfig)
    """Options of the segmenter sam, but for its model."""


def variants() -> dict[str, Variant]:
    base, paper = TrimConfig(), paper_config()
    close, eq_6 = replace(paper, plan=base.plan), paper_sam()

    def with_views(n: int) -> Variant:
        return Variant(replace(base, plan=replace(base.plan, views=n)))

    no_background = replace(base, context_radius=0.0)
    at_support_plane = SplitConfig(at_support_plane=SupportPlaneSplitConfig(enabled=True))
    named = {
        "default": Variant(),
        "grabcut": Variant(segmenter="grabcut"),
        "paper": Variant(paper, PAPER_SEGMENTER),
        "sagd": Variant(replace(paper, split=SplitConfig("sagd")), PAPER_SEGMENTER),
        "sam": Variant(segmenter="sam"),
        "sam-alone": Variant(segmenter="sam", sam=SamConfig(fusion=False)),
        "paper-sam": Variant(paper, "sam", sam=eq_6),
        "paper-sam-close": Variant(close, "sam", sam=eq_6),
        "paper-sam-sagd-split": Variant(replace(paper, split=SplitConfig("sagd")), "sam", sam=eq_6),
        "paper-sam-plane-split": Variant(replace(paper, split=SplitConfig("plane")), "sam", sam=eq_6),
        "paper-sam-no-split": Variant(replace(paper, split=SplitConfig("none")), "sam", sam=eq_6),
        "paper-sam-no-virtual-cameras": Variant(paper, "sam", 5, eq_6),
        "paper-sam-no-background": Variant(replace(paper, context_radius=0.0), "sam", sam=eq_6),
        "paper-sam-neither": Variant(replace(paper, context_radius=0.0), "sam", 5, eq_6),
        "principal-axis": Variant(replace(base, split=SplitConfig("principal_axis"))),
        "sagd-split": Variant(replace(base, split=SplitConfig("sagd"))),
        "no-split": Variant(replace(base, split=SplitConfig("none"))),
        "support-plane-split": Variant(replace(base, split=at_support_plane)),
        "no-second-evidence": Variant(replace(base, evidence=replace(base.evidence, second_evidence=False))),
        "no-recover": Variant(replace(base, evidence=replace(base.evidence, recover=False))),
        "no-label-crf": Variant(replace(base, label_crf=replace(base.label_crf, enabled=False))),
        "no-virtual-cameras": Variant(training_views=5),
        "no-background": Variant(no_background),
        "neither": Variant(no_background, training_views=5),
    }
    for n in (1, 2, 3, 5, 7, 10):
        named[f"views-{n}"] = with_views(n)
        few = replace(paper, plan=replace(paper.plan, views=n))
        named[f"paper-sam-views-{n}"] = Variant(few, "sam", sam=eq_6)
    return named


@dataclass(frozen=True)
class Arguments:
    """Measure trims against ground truth."""

    root: tyro.conf.Positional[Path]
    """Folder with benchmark scenes, or one scene."""
    variants: tuple[str, ...] = ("default",)
    """Ways of running the trimmer, side by side; `ablations` stands for all of them that need no SAM."""
    sam_model: Path | None = None
    """Folder with a model for the variants that have sam in their names."""
    objects: tuple[str, ...] = ()
    """Only these objects."""
    kinds: tuple[str, ...] = ()
    """Only these kinds of coarse selection; `box` is a box around the object, wider by a tenth of its radius."""
    without_cameras: bool = False
    """Give the trimmer neither cameras nor up vector."""
    output: Path | None = None
    """Folder for results.json and picture sheets."""
    all_views: bool = False
    """Count far test views as well."""
    fidelity: bool = True
    """Also compare object and background together with the untouched scene."""


@dataclass(frozen=True)
class Row:
    """One trim and its scores."""

    scene: str
    object: str
    kind: str
    variant: str
    before: Scores
    after: Scores
    fidelity: float
    seconds: float
    refused: str
    counts: dict[str, int]

    @property
    def iou_change(self) -> float:
        """Points of foreground IoU that the trim gained."""
        return self.after["iou"] - self.before["iou"]

    @property
    def loses(self) -> bool:
        """Whether the trim did harm."""
        return self.iou_change < -_LOSS


def main() -> None:
    arguments = tyro.cli(Arguments)
    console = Console(width=160)
    chosen = (
        [name for name in variants() if "sam" not in name]
        if "ablations" in arguments.variants
        else list(arguments.variants)
    )
    rows = []
    for folder in find_scenes(arguments.root):
        for row in measure_scene(open_scene(folder), chosen, arguments, console):
            rows.append(row)
            loss = "  LOSS" if row.loses else ""
            shown = "  ".join(
                f"{m} {row.before[m]:5.1f} -> {row.after[m]:5.1f}" for m in ("iou", "boundary_iou", "psnr")
            )
            run = f"{row.variant:18s} {row.kind:12s} {row.scene}/{row.object:12s}"
            tail = f"fidelity {row.fidelity:4.1f}  {row.seconds:4.1f} s{loss} {row.refused}"
            console.print(f"{run} {shown}  {tail}", highlight=False, soft_wrap=True)
    if not rows:
        raise SystemExit(f"Nothing to measure in '{arguments.root}': no scene has such objects and selections.")
    for variant in chosen:
        of_variant = [row for row in rows if row.variant == variant]
        console.print(_table(variant, of_variant))
        console.print(_scene_table(variant, of_variant))
    if arguments.output:
        arguments.output.mkdir(parents=True, exist_ok=True)
        (arguments.output / "results.json").write_text(json.dumps([row.__dict__ for row in rows], indent=1))


def measure_scene(
    scene: BenchmarkScene, chosen: Sequence[str], arguments: Arguments, console: Console
) -> Iterator[Row]:
    cameras = None if arguments.without_cameras else _training_cameras(scene.cameras_file)
    for name in scene.objects:
        if arguments.objects and name not in arguments.objects:
            continue
        views = [view for view in scene.test_views(name) if arguments.all_views or not view.far]
        untouched = [_render(scene.gaussians, view).rgb for view in views] if arguments.fidelity else []
        for kind in arguments.kinds or scene.coarse_kinds(name):
            coarse = _box(scene, name) if kind == "box" else scene.coarse(name, kind)
            if _too_few(scene, name, kind, coarse):
                console.print(f"left out: {scene.name}/{name} {kind}, {coarse.sum()} Gaussians", highlight=False)
                continue
            before, before_sheet = _score(scene.gaussians.select(coarse), views)
            for variant in chosen:
                start = time.perf_counter()
                result = _trim(scene, coarse, variants()[variant], cameras, arguments)
                seconds = time.perf_counter() - start
                after, after_sheet = _score(result.object, views)
                fidelity = _fidelity(result, views, untouched)
                if arguments.output:
                    _write_sheet(
                        arguments.output / variant / f"{scene.name}_{name}_{kind}.png", views, before_sheet, after_sheet
                    )
                counts = {label.name.lower(): result.count(label) for label in RowLabel}
                yield Row(scene.name, name, kind, variant, before, after, fidelity, seconds, result.refused, counts)


def _too_few(scene: BenchmarkScene, name: str, kind: str, coarse: BoolArray) -> bool:
    """Whether the selection holds less than a tenth of what the kind `exact` holds."""
    if kind == "exact" or "exact" not in scene.coarse_kinds(name):
        return False
    return bool(coarse.sum() < _SMALLEST_SELECTION * scene.coarse(name, "exact").sum())


def _box(scene: BenchmarkScene, name: str, margin: float = 0.1) -> BoolArray:
    """What an upright box around the object holds: percentiles 1 to 99 of its centres, and a margin in radii."""
    axes = up_frame(scene.up if scene.up is not None else np.array([0.0, -1.0, 0.0]))
    positions = scene.gaussians.means @ axes.T
    low, high = np.percentile(positions[scene.coarse(name, "exact")], [1, 99], axis=0)
    reach = margin * np.linalg.norm(high - low) / 2
    return np.asarray(((positions > low - reach) & (positions < high + reach)).all(axis=1))


def _training_cameras(path: Path) -> CameraSet:
    """The training cameras alone: held-out views are ground truth."""
    listed = read_camera_set(path)
    kept = tuple(camera for camera, train in zip(listed.cameras, listed.train, strict=True) if train)
    return replace(listed, cameras=kept, train=(True,) * len(kept))


def _trim(
    scene: BenchmarkScene, coarse: BoolArray, variant: Variant, cameras: CameraSet | None, arguments: Arguments
) -> TrimResult:
    config = variant.config
    if scene.up is not None and not arguments.without_cameras:
        config = replace(config, up=tuple(scene.up.tolist()))
    views = None
    if variant.training_views:
        n = len(scene.training_cameras)
        views = [scene.training_cameras[i * n // variant.training_views] for i in range(variant.training_views)]
    segmenter = _sam(replace(variant.sam, model=str(arguments.sam_model or ""))) if variant.segmenter == "sam" else None
    return trim(
        scene.gaussians, coarse, config=config, segmenter=segmenter or variant.segmenter, cameras=cameras,
        view_cameras=views,
    )  # fmt: skip


@cache
def _sam(options: SamConfig) -> Segmenter:
    """A segmenter whose model is loaded once for all trims."""
    return get_segmenter("sam", options)


def _render(gaussians: Gaussians, view: TestView) -> Any:
    return get_renderer("numba").render(gaussians, view.camera)


def _score(gaussians: Gaussians, views: Sequence[TestView]) -> tuple[Scores, list[Any]]:
    """Mean of each metric over the views, percentages and dB; and the renderings."""
    renderings = [_render(gaussians, view) for view in views]
    scores = []
    for shown, view in zip(renderings, views, strict=True):
        silhouettes = (shown.alpha, view.coverage, view.valid)
        scores.append((
            100 * metrics.foreground_iou(*silhouettes), 100 * metrics.pixel_accuracy(*silhouettes),
            100 * metrics.boundary_iou(*silhouettes), 100 * metrics.soft_iou(*silhouettes),
            min(metrics.extraction_psnr(shown.rgb, view.image, view.coverage, valid=view.picture_valid), _HIGHEST_PSNR),
        ))  # fmt: skip
    return dict(zip(METRICS, np.mean(scores, axis=0).tolist(), strict=True)), renderings


def _fidelity(result: TrimResult, views: Sequence[TestView], untouched: Sequence[Any]) -> float:
    """PSNR of object and background together against the untouched scene, capped at 100 dB."""
    if not untouched:
        return float("nan")
    together = concatenate([result.object, result.background])
    values = [
        metrics.psnr(np.clip(_render(together, v).rgb, 0, 1), np.clip(u, 0, 1))
        for v, u in zip(views, untouched, strict=True)
    ]
    return float(np.mean(np.minimum(values, _HIGHEST_PSNR)))


def _table(variant: str, rows: Sequence[Row]) -> Table:
    """Means by kind of coarse selection, before -> after."""
    table = Table(title=f"{variant}: {len(rows)} trims, {sum(bool(r.refused) for r in rows)} refused")
    for column in ("coarse", *METRICS, "worst iou change", "fidelity", "median s"):
        table.add_column(column, justify="left" if column == "coarse" else "right")
    for kind in [*sorted({row.kind for row in rows}), "all"]:
        chosen = [row for row in rows if kind in (row.kind, "all")]
        cells = [_before_after(chosen, metric) for metric in METRICS]
        worst = min(chosen, key=lambda row: row.iou_change)
        table.add_row(
            kind, *cells, f"{worst.iou_change:+.2f} {worst.object}",
            f"{np.mean([row.fidelity for row in chosen]):.1f}", f"{np.median([row.seconds for row in chosen]):.2f}",
        )  # fmt: skip
    return table


def _scene_table(variant: str, rows: Sequence[Row]) -> Table:
    """Means of each scene folder, before -> after, its worst trim, and how many trims did harm or were refused."""
    table = Table(title=f"{variant}: scenes; a loss is more than {_LOSS} points of IoU")
    for column in ("scene", "trims", *METRICS, "worst iou change", "losses", "refused"):
        table.add_column(column, justify="left" if column == "scene" else "right")
    for scene in [*sorted({row.scene for row in rows}), "all"]:
        chosen = [row for row in rows if scene in (row.scene, "all")]
        worst = min(chosen, key=lambda row: row.iou_change)
        table.add_row(
            scene, str(len(chosen)), *(_before_after(chosen, metric) for metric in METRICS),
            f"{worst.iou_change:+.2f} {worst.object} {worst.kind}",
            str(sum(row.loses for row in chosen)), str(sum(bool(row.refused) for row in chosen)),
        )  # fmt: skip
    return table


def _before_after(rows: Sequence[Row], metric: str) -> str:
    """Means of one metric over the trims."""
    before, after = (np.mean([getattr(row, side)[metric] for row in rows]) for side in ("before", "after"))
    return f"{before:.2f} -> {after:.2f}"


def _write_sheet(path: Path, views: Sequence[TestView], before: Sequence[Any], after: Sequence[Any]) -> None:
    """Ground truth, coarse, trimmed and both error maps (red: too much, green: missing), one row a view."""
    rows = []
    for view, coarse, trimmed in zip(views, before, after, strict=True):
        grey = np.float32(0.35)
        truth = view.image * view.coverage[..., None] + grey * (1 - view.coverage[..., None])
        shown = [truth] + [np.clip(r.rgb + grey * (1 - r.alpha[..., None]), 0, 1) for r in (coarse, trimmed)]
        errors = [_errors(r.alpha, view) for r in (coarse, trimmed)]
        rows.append(np.concatenate([*shown, *errors], axis=1))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), (np.concatenate(rows)[..., ::-1] * 255).astype(np.uint8))


def _errors(alpha: Any, view: TestView) -> Any:
    ours, truth = alpha > 0.5, view.coverage > 0.5
    picture = np.repeat(0.6 * view.image.mean(axis=2, keepdims=True), 3, axis=2)
    picture[ours & ~truth & view.valid] = (1, 0.1, 0.1)
    picture[~ours & truth & view.valid] = (0.1, 1, 0.1)
    picture[~view.valid] *= 0.5
    return picture


if __name__ == "__main__":
    main()
