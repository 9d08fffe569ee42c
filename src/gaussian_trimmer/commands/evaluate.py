"""`gaussian-trimmer evaluate`: a trim, or any other tool's object, against ground-truth masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.tables import Findings, TableOptions, publish, results_folder
from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.evaluation.clip_iqa import load_scorer
from gaussian_trimmer.evaluation.error_page import WorstViews, error_page
from gaussian_trimmer.evaluation.ground_truth import TestView, views_in
from gaussian_trimmer.evaluation.results import StoredResult, cut_by, read_result
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Occlusion, Scores, Shown, mean_scores
from gaussian_trimmer.evaluation.sheets import comparison_sheet
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable, heading, known_metrics, score_cells
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.output.html.report_page import REPORT
from gaussian_trimmer.output.pictures import Picture
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES, get_renderer
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Share, check_settings

_SHEET_ROWS = 8


@dataclass(frozen=True)
class RuleOptions:
    """The rules of a comparison with ground truth."""

    threshold: Share = 0.5
    """Opacity above which a rendered pixel belongs to the object."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views."""

    clip: Annotated[str, arg(metavar="MODEL")] = ""
    """Also score the looks of the object by CLIP-IQA with this CLIP model: a folder, or a name on the Hugging Face
    hub. Only with the object rendered alone."""

    def judge(self, *occlusion: Occlusion) -> list[Judge]:
        """A judge for each rule of occlusion, with one renderer and one CLIP model.

        Raises:
            InputError: looks are to be judged and no object is rendered alone, or what they need is missing.
        """
        if self.clip and "alone" not in occlusion:
            raise InputError("CLIP-IQA judges the object rendered alone; leave --clip out, or use --occlusion alone.")
        renderer, looks = get_renderer(self.renderer), load_scorer(self.clip)
        return [Judge(renderer, self.threshold, rule, looks) for rule in occlusion]


@dataclass(frozen=True)
class Evaluate:
    """Compare a trim, or any other tool's object, with ground-truth masks of held-out pictures.

    RESULT is a folder that `trim` wrote, a splat file of the object, or a selection file. A mask belongs to the picture
    with the same name; it may have another size, and the view is then rendered at the mask's. Other commands: evaluate
    nvos, lerf-mask, spin-nerf (published data sets), benchmark, ablation, view-counts and sheets.
    """

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene."""
    result: Annotated[Positional[Path], arg(metavar="RESULT")]
    """What is measured."""
    masks: Annotated[Path, arg(metavar="DIR")]
    """Folder of ground-truth masks; the object is bright."""
    cameras: Annotated[Path, arg(metavar="PATH")]
    """Cameras of the masks: a COLMAP folder, transforms.json or cameras.json."""
    images: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the photographs of the masked views, for the extraction PSNR."""
    ignore: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of masks of pixels that do not count, such as those where other objects stand before this one."""
    before: Annotated[Path | None, arg(metavar="FILE")] = None
    """Selection or object before the trim; a folder of `trim` holds it already."""
    occlusion: Occlusion = "alone"
    """Render the object alone, or measure its share of the whole scene's picture."""
    html: bool = False
    """Also write report.html to the folder of --output: the table, and maps of errors to move through, on one page."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    quiet: bool = False
    """Print nothing but errors."""
    rules: Annotated[RuleOptions, arg(name="")] = field(default_factory=RuleOptions)
    tables: Annotated[TableOptions, arg(name="")] = field(default_factory=TableOptions)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How RESULT and the file before are read if they are selection files."""

    def run(self) -> None:
        """Measure, print the table, and write it if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        console = open_console(quiet=self.quiet)
        check_settings(self.rules)
        check_settings(self.selection_options, "selection")
        if self.html and self.tables.output is None:
            raise InputError("--html writes report.html to the folder of --output; give it with --output DIR.")
        with results_folder(self.tables) as folder:
            publish(self._measure(console), self.tables, console, folder)

    def _measure(self, console: Console) -> Findings:
        scene = formats.read(self.scene)
        cameras = read_cameras_of(self.scene, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        found, views = views_in(cameras, self.masks, self.images, self.ignore)
        after = read_result(self.result, scene, self.selection_options)
        before = self._before(after, scene)
        (judge,) = self.rules.judge(self.occlusion)
        if after.unknown_background and self.occlusion == "alone":
            console.print(f"Fidelity is left out, since the scene without the object is unknown: "
                          f"{after.unknown_background}")  # fmt: skip
        worst = WorstViews(judge.threshold) if self.html else None
        scored, sheet = _score(
            scene, before, after.cut, views, judge, sheet=self.tables.output is not None, worst=worst
        )
        notes = [judge.describe(), f"views: {len(found)}, those of {len(cameras)} cameras with a mask; mean over views"]
        table = table_of_views(f"{shown(self.result.name)} in {shown(self.scene.name)}", scored, notes)
        pictures = {"sheet.png": sheet} if sheet is not None else {}
        texts = {REPORT: error_page(table, worst)} if worst is not None else {}
        return Findings({"scores": table}, pictures, texts)

    def _before(self, after: StoredResult, scene: Gaussians) -> Cut | None:
        if self.before is not None:
            return read_result(self.before, scene, self.selection_options).cut
        if after.before is not None:
            return cut_by(scene, after.before)
        if self.result.is_dir():
            raise InputError(
                f"'{self.result}' does not say which Gaussians were selected before the trim, since some were split; "
                "give the selection with --before FILE."
            )
        return None


ScoredView = tuple[str, Scores | None, Scores]
"""Name of a view, its scores before, if known, and after."""


def _score(
    scene: Gaussians, before: Cut | None, after: Cut, views: Iterator[TestView], judge: Judge, *, sheet: bool,
    worst: WorstViews | None = None,
) -> tuple[list[ScoredView], Picture | None]:  # fmt: skip
    """Scores of every view, one view in memory at a time but for those on the sheet; the worst are drawn if asked."""
    alone = replace(judge, occlusion="alone")
    whole = Cut(scene, scene.select(slice(0, 0)))
    scored: list[ScoredView] = []
    kept: list[tuple[TestView, Shown | None, Shown]] = []
    for view in views:
        now = judge.show(after, view.camera)
        then = judge.show(before, view.camera) if before is not None else None
        scores = judge.score(now, view)
        if after.background is not None:
            scores |= judge.fidelity(after, view.camera, alone.show(whole, view.camera).rgb)
        scored.append((shown(view.camera.name), judge.score(then, view) if then else None, scores))
        if worst is not None:
            worst.add(view, shown(view.camera.name), then, now, scores)
        if sheet and len(kept) < _SHEET_ROWS:
            kept.append((view, then, now))
    if not kept:
        return scored, None
    shown_before = [then for _, then, _ in kept if then is not None]
    return scored, comparison_sheet(
        [view for view, _, _ in kept], shown_before or None, [now for _, _, now in kept], judge.threshold
    )


def table_of_views(title: str, scored: list[ScoredView], notes: list[str]) -> ScoreTable:
    """A row for each view and one of their mean."""
    metrics = known_metrics(*(after for _, _, after in scored))
    rows: list[list[Cell]] = [[name, *score_cells(metrics, before, after)] for name, before, after in scored]
    befores = [before for _, before, _ in scored if before is not None]
    mean = mean_scores(after for _, _, after in scored)
    rows.append(["mean", *score_cells(metrics, mean_scores(befores) if befores else None, mean)])
    return ScoreTable(title, ["view", *map(heading, metrics)], rows, notes)
