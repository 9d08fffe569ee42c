"""Results of a trim or of any other tool, as a scene cut in two, and how well they match ground truth in views.

Published codes differ in whether the object is rendered alone or counts only where nothing hides it in its scene.
Both are measured: `alone` compares the object's own opacity with the mask, `in scene` its share of the whole scene's
rendering, with everything else before it. They differ as well in the threshold that makes a mask of an opacity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation import metrics
from gaussian_trimmer.evaluation.ground_truth import TestView
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, concatenate, mask_of_rows
from gaussian_trimmer.io.reading import is_folder, path_inside, read_json
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.selection_files import SelectionOptions, kinds, load_selection
from gaussian_trimmer.selection_files.kinds import MASK, check_ids
from gaussian_trimmer.selection_files.selection_file import open_selection

Scores = dict[str, float]
"""Metric -> percentage, or dB for `psnr` and `fidelity`; a metric that is not known is missing."""

METRICS: Mapping[str, str] = {
    "iou": "IoU",
    "accuracy": "accuracy",
    "boundary_iou": "boundary IoU",
    "soft_iou": "soft IoU",
    "acc25": "Acc@0.25",
    "iou_in_scene": "IoU in scene",
    "accuracy_in_scene": "accuracy in scene",
    "boundary_iou_in_scene": "boundary IoU in scene",
    "acc25_in_scene": "Acc@0.25 in scene",
    "psnr": "extraction PSNR",
    "fidelity": "fidelity",
    "clip_clear": "CLIP-IQA clear boundary",
    "clip_smooth": "CLIP-IQA smooth boundary",
    "clip_complete": "CLIP-IQA complete object",
}
"""Name of a metric in files -> its name in tables, in their order. All are in percent but `psnr` and `fidelity`, dB."""
RULES: Mapping[str, str] = {"alone": "", "in scene": "_in_scene"}
"""Rule of occlusion -> what the names of its metrics end with."""
ACC25 = ("acc25", "acc25_in_scene")
"""Share of masks with an IoU above a quarter, which says something of many masks together."""
_ACC25_IOU = 25.0


@dataclass(frozen=True, eq=False)
class Cut:
    """A scene cut in two, by a trim or by any other tool."""

    object: Gaussians
    background: Gaussians | None
    """The scene without the object; None if it is not known."""
    selection: BoolArray | None = None
    """Rows of the scene that the object has, whole or in part, (N,); None if they are not known."""
    before: BoolArray | None = None
    """Rows of the scene that were selected before the trim, (N,); None if they are not known."""
    unknown: str = ""
    """Why the background or the rows are not known."""


def cut_by(scene: Gaussians, selection: BoolArray) -> Cut:
    """Return the scene cut in two by a selection (N,)."""
    return Cut(scene.select(selection), scene.select(~selection), selection)


@dataclass(frozen=True)
class Judge:
    """The rules of a comparison with ground truth."""

    threshold: float = metrics.THRESHOLD
    """Opacity above which a rendered pixel belongs to the object."""
    looks: metrics.ClipScorer | None = None
    """Also judges how the object looks."""

    def describe(self) -> str:
        """Return the rules in words, for tables."""
        mask = f"mask: alpha > {self.threshold:g}, ground truth > 0.5"
        occlusion = "object rendered alone, or in scene: its share of the whole rendering, where occlusion counts"
        return "; ".join([mask, occlusion, *([self.looks.describe()] if self.looks else [])])

    def score_views(self, cut: Cut, views: Sequence[TestView], scene: Gaussians | None = None) -> list[Scores]:
        """Return the metrics of each view, see `score`."""
        drawn = parallel_map(lambda view: draw(cut, view.camera), views)
        scores = [self.score(*shown, view) for shown, view in zip(drawn, views, strict=True)]
        if scene is not None and cut.background is not None:
            together = concatenate([cut.object, cut.background])
            for score, view in zip(scores, views, strict=True):
                pictures = (np.clip(_rendered(part, view.camera)[0], 0, 1) for part in (together, scene))
                score["fidelity"] = min(metrics.psnr(*pictures), metrics.HIGHEST_PSNR)
        return scores

    def score(self, rgb: FloatArray, alpha: FloatArray, share: FloatArray | None, view: TestView) -> Scores:
        """Return the metrics of one view of an object, without `fidelity`; if it is not to be seen, only the accuracy.

        Args:
            rgb, alpha, share: as `draw` returns them; another size is brought to the mask's by the nearest pixel.
            view: what they are compared with; without a picture there is no `psnr`.
        """
        shape = view.coverage.shape
        rgb, alpha = nearest(rgb, shape), nearest(alpha, shape)
        scores = self._silhouette_scores(alpha, view.coverage, view.counted)
        seen = "iou" in scores
        if seen:
            scores["soft_iou"] = 100 * metrics.soft_iou(alpha, view.coverage, view.counted)
        if share is not None:
            in_scene = self._silhouette_scores(nearest(share, shape), *view.in_scene)
            scores |= {name + RULES["in scene"]: value for name, value in in_scene.items()}
        if view.image is not None and seen:
            psnr = metrics.extraction_psnr(rgb, view.image, view.coverage, valid=view.picture_counted)
            scores["psnr"] = min(psnr, metrics.HIGHEST_PSNR)
        if self.looks is not None:
            scores |= self.looks.score(rgb, alpha, self.threshold)
        return scores

    def _silhouette_scores(self, silhouette: FloatArray, coverage: FloatArray, counted: BoolArray) -> Scores:
        compared = silhouette, coverage, counted
        accuracy = 100 * metrics.pixel_accuracy(*compared, self.threshold)
        if not ((coverage > metrics.THRESHOLD) & counted).any():
            return {"accuracy": accuracy}
        iou = 100 * metrics.foreground_iou(*compared, self.threshold)
        return {
            "iou": iou,
            "accuracy": accuracy,
            "boundary_iou": 100 * metrics.boundary_iou(*compared, self.threshold),
            "acc25": 100.0 * (iou > _ACC25_IOU),
        }


def draw(cut: Cut, camera: Camera) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Render an object alone and in its scene.

    Returns:
        The object over black, not clipped above one, (H, W, 3); its opacity, (H, W); and its share of the whole scene's
        rendering, (H, W), or None if the background is not known.
    """
    rgb, alpha = _rendered(cut.object, camera)
    if cut.background is None:
        return rgb, alpha, None
    member = np.arange(len(cut.object) + len(cut.background)) < len(cut.object)
    whole = concatenate([cut.object, cut.background])
    return rgb, alpha, blend_values(whole, camera, member[:, None].astype(np.float32))[..., 0]


def mean_scores(scores: Iterable[Scores]) -> Scores:
    """Return the mean of each metric over the scores that have it; nothing if there are none.

    >>> mean_scores([{"iou": 90.0, "psnr": 30.0}, {"iou": 80.0}])
    {'iou': 85.0, 'psnr': 30.0}
    """
    scores = list(scores)
    found = {name: [score[name] for score in scores if name in score] for name in METRICS}
    return {name: float(np.mean(values)) for name, values in found.items() if values}


def nearest(picture: FloatArray, shape: Sequence[int]) -> FloatArray:
    """Resample a picture (H, W, ...) to another height and width by the nearest pixel.

    >>> nearest(np.float32([[1, 2]]), (1, 4)).tolist()
    [[1.0, 1.0, 2.0, 2.0]]
    """
    if picture.shape[:2] == tuple(shape):
        return picture
    rows, columns = (((np.arange(n) + 0.5) * m / n).astype(int) for n, m in zip(shape, picture.shape, strict=False))
    return np.asarray(picture[rows][:, columns])


def _rendered(gaussians: Gaussians, camera: Camera) -> tuple[FloatArray, FloatArray]:
    if not len(gaussians):
        blank = np.zeros((camera.height, camera.width, 3), np.float32)
        return blank, blank[..., 0]
    rendering = render(gaussians, camera)
    return rendering.rgb, rendering.alpha


def read_result(path: Path, scene: Gaussians, options: SelectionOptions | None = None) -> Cut:
    """Return the object that a folder of a trim, a splat file or a selection file holds.

    - A folder must be one that `gaussian-trimmer trim` wrote: object, background, and the selection before the trim. Of
      several objects the options name one.
    - A splat file with fewer Gaussians than the scene is the object itself. The background is the scene without the
      object's rows, if they are found in it.
    - Anything else is a selection of the scene's rows.

    Args:
        path: folder or file.
        scene: all N Gaussians.
        options: how a selection file is read.

    Raises:
        InputError: nothing readable is there, or it does not fit the scene.
    """
    if is_folder(path):
        return _read_folder(path, scene, options.object_id if options else ())
    if path.name.lower().endswith(tuple(formats.FORMATS)):
        columns = open_selection(path, len(scene)).columns
        if columns is not None and MASK not in columns and len(columns["x"]) < len(scene):
            return _read_object(path, scene)
    return cut_by(scene, load_selection(path, scene, options))


def read_background(path: Path) -> Gaussians:
    """Return the scene without the object: the background in a folder of a trim, or a splat file of any program.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    if not is_folder(path):
        return formats.read(path)
    found = _only(path, "background")
    if found is None:
        raise InputError(f"'{path}' holds no background file; give the splat file of the scene without the object.")
    return formats.read(found)


def _read_object(path: Path, scene: Gaussians) -> Cut:
    found = formats.read(path)
    try:
        selection = load_selection(path, scene)
    except InputError as error:
        return Cut(found, None, unknown=str(error))
    return Cut(found, scene.select(~selection), selection)


def _read_folder(folder: Path, scene: Gaussians, wanted: Sequence[int]) -> Cut:
    """Return the object of a trim's folder, or of several the one with an id; the others are part of the background."""
    labels, n = folder / "labels.npz", len(scene)
    if not labels.is_file():
        raise InputError(
            f"'gaussian-trimmer trim' did not write the folder '{folder}': it lacks labels.npz; name another tool's "
            "file itself."
        )
    file = open_selection(labels, n)
    rows = kinds.rows_of_objects(file, n)
    if wanted or len(rows) > 1:
        check_ids(wanted, list(rows), [len(own) for own in rows.values()], folder)
    files = _object_files(folder, list(rows))
    parts = {number: formats.read(path) for number, path in files.items()}
    chosen = [number for number in rows if not wanted or number in wanted]
    background = _only(folder, "background")
    rest = [formats.read(background), *(parts[i] for i in parts if i not in chosen)] if background else None
    nothing = scene.select(slice(0, 0))
    before = kinds.selected_rows(file, n)
    return Cut(
        concatenate([nothing, *(parts[i] for i in chosen if i in parts)]),
        concatenate(rest) if rest else None,
        mask_of_rows(np.concatenate([rows[number] for number in chosen]), n),
        None if before is None else mask_of_rows(before, n),
        "" if background else f"'{folder}' holds no background file.",
    )


def _object_files(folder: Path, ids: Sequence[int]) -> dict[int, Path]:
    """Return the splat files of a trim's objects by their ids; those without a single Gaussian have none."""
    if len(ids) == 1 and (only := _only(folder, "object")):
        return {ids[0]: only}
    try:
        entries = {entry["id"]: entry["file"] for entry in read_json(folder / "report.json")["objects"]}
        found = {number: path_inside(folder, str(entries[number])) for number in ids if entries[number]}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"'{folder}' lacks an object file, or its report.json the names of several.") from error
    return {number: path for number, path in found.items() if path is not None}


def _only(folder: Path, stem: str) -> Path | None:
    """Return the splat file of that name, whatever its format; None if there is none.

    Raises:
        InputError: there are several.
    """
    found = [path for ending in formats.FORMATS if (path := folder / f"{stem}{ending}").is_file()]
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise InputError(f"'{folder}' holds several files of the {stem} ({names}); leave one.")
    return found[0] if found else None
