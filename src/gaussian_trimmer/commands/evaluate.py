"""`gaussian-trimmer evaluate`: a trim, or any other tool's object, against ground-truth masks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.commands.tables import Findings, TableOptions
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.clip_iqa import ClipScorer
from gaussian_trimmer.evaluation.ground_truth import views_in
from gaussian_trimmer.evaluation.results import StoredResult, cut_by, read_result
from gaussian_trimmer.evaluation.scoring import Cut, Judge, Scores, mean_scores
from gaussian_trimmer.evaluation.statistics import made_by
from gaussian_trimmer.evaluation.tables import Cell, ScoreTable, heading, known_metrics, score_cells
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES, get_renderer
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Share, check_settings


@dataclass(frozen=True)
class RuleOptions:
    """The rules of a comparison with ground truth."""

    threshold: Share = 0.5
    """Opacity above which a rendered pixel belongs to the object."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views."""
    clip: Annotated[str | None, arg(metavar="MODEL")] = None
    """Also score the object's look by CLIP-IQA, with this CLIP model: a folder, or a name on the Hugging Face hub."""

    def judge(self) -> Judge:
        """A judge by these rules.

        Raises:
            InputError: a rule is not possible, or what it needs is missing.
        """
        check_settings(self)
        return Judge(get_renderer(self.renderer), self.threshold, ClipScorer(self.clip) if self.clip else None)


@dataclass(frozen=True)
class Evaluate:
    """Compare a trim, or any other tool's object, with ground-truth masks of held-out pictures.

    RESULT is a folder that `trim` wrote, a splat file of the object, or a selection file. A mask belongs to the picture
    with the same name; it may have another size, and the view is then rendered at the mask's. Scores are of the object
    rendered alone, and of its share of the whole scene, where what stands before it hides it. Published data sets have
    commands of their own, such as evaluate nvos, and evaluate removal measures the scene without the object.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer evaluate scene.ply trimmed --masks test_masks --cameras sparse/0",
        "gaussian-trimmer evaluate scene.ply object.ply --before rough.npy --masks test_masks --cameras sparse/0",
    )

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene."""
    result: Annotated[Positional[Path], arg(metavar="RESULT")]
    """What to score: a folder of `trim`, a splat file of the object, or a selection file."""
    masks: Annotated[Path, arg(metavar="DIR")]
    """Folder of ground-truth masks, in which the object is bright."""
    cameras: Annotated[Path, arg(metavar="PATH")]
    """Cameras of the masks: a COLMAP folder, transforms.json or cameras.json."""
    images: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the photographs of the masked views, for the extraction PSNR."""
    ignore: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of masks of pixels that do not count, such as those where others stand before the object."""
    before: Annotated[Path | None, arg(metavar="FILE")] = None
    """Selection or object before the trim. A folder of `trim` holds it already."""
    trust_paths: bool = False
    """Open pictures that a transforms.json names outside its folder, if it does not say their size."""
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
        check_settings(self.selection_options, "selection")
        self.tables.publish(self._measure, open_console(quiet=self.quiet))

    def _measure(self) -> Findings:
        judge = self.rules.judge()
        scene = formats.read(self.scene)
        cameras = read_cameras_of(self.scene, self.cameras, trust_paths=self.trust_paths).pinhole_cameras()
        found, views = views_in(cameras, self.masks, self.images, self.ignore)
        result = read_result(self.result, scene, self.selection_options)
        before, scored = self._before(result, scene), []
        for view in views:
            then = judge.score(judge.show(before, view.camera), view) if before else None
            now = judge.score(judge.show(result.cut, view.camera), view)
            if result.cut.background is not None:
                now |= judge.fidelity(result.cut, view.camera, judge.renderer.render(scene, view.camera).rgb)
            scored.append(ViewScores(clip_name(view.camera.name), then, now))
        notes = [judge.describe(), f"views: {len(found)}, those of {len(cameras)} cameras with a mask; mean over views"]
        notes.append(made_by())
        if result.unknown_background:
            notes.append(
                f"without scores in scene and fidelity, which need the background: {result.unknown_background}"
            )
        title = f"{clip_name(self.result.name)} in {clip_name(self.scene.name)}"
        return Findings({"scores": table_of_views(title, scored, notes)})

    def _before(self, result: StoredResult, scene: Gaussians) -> Cut | None:
        if self.before is not None:
            return read_result(self.before, scene, self.selection_options).cut
        if result.before is not None:
            return cut_by(scene, result.before)
        if self.result.is_dir():
            raise InputError(
                f"'{self.result}' does not say which Gaussians were selected before the trim; give the selection with "
                "--before FILE."
            )
        return None


@dataclass(frozen=True)
class ViewScores:
    """The scores of one view."""

    view: str
    before: Scores | None
    after: Scores


def table_of_views(title: str, scored: list[ViewScores], notes: list[str]) -> ScoreTable:
    """A row for each view and one of their mean."""
    befores = [view.before for view in scored if view.before is not None]
    mean = ViewScores("mean", mean_scores(befores) or None, mean_scores(view.after for view in scored))
    metrics = known_metrics(mean.after)
    rows: list[list[Cell]] = [[row.view, *score_cells(metrics, row.before, row.after)] for row in [*scored, mean]]
    return ScoreTable(title, ["view", *map(heading, metrics)], rows, notes)
