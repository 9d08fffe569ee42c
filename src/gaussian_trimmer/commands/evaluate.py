"""`gaussian-trimmer evaluate`: a trim, or any other tool's objects, against ground truth, and `evaluate removal`."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from json import dumps
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.commands.arguments import TRUST, selection_options_of
from gaussian_trimmer.commands.console import add_printing, open_console
from gaussian_trimmer.errors import InputError, clip_name
from gaussian_trimmer.evaluation.datasets import folders_in
from gaussian_trimmer.evaluation.ground_truth import (
    IGNORED,
    check_folders,
    find_picture,
    read_photograph,
    view_of,
    views_in,
)
from gaussian_trimmer.evaluation.metrics import (
    INPAINT_RADIUS,
    THRESHOLD,
    ClipScorer,
    inpaint,
    ious_of,
    likeness,
    shared_pixels,
)
from gaussian_trimmer.evaluation.scoring import (
    RULES,
    Cut,
    Judge,
    Scores,
    cut_by,
    mean_scores,
    read_background,
    read_result,
)
from gaussian_trimmer.evaluation.tables import (
    MADE_BY,
    Cell,
    ScoreTable,
    heading,
    known_metrics,
    score_cells,
    table_of_methods,
    write_tables,
)
from gaussian_trimmer.evaluation.trials import Run
from gaussian_trimmer.gaussians import FloatArray, Gaussians
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.masks.mask_files import find_mask, find_masks
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selection_files import SelectionOptions, load_objects
from gaussian_trimmer.settings import Range, Share
from gaussian_trimmer.views.view import grown

Findings = tuple[Mapping[str, ScoreTable], Sequence[Run], Mapping[str, Any]]
"""Tables by the names of their files, runs, and everything that was set."""


ABOUT = """Compare a trim, or any other tool's objects, with ground-truth masks of held-out pictures.

RESULT is a folder that `trim` wrote, a splat file of the object, or a selection file. A mask belongs to the picture
with the same name; it may have another size, and the view is then rendered at the mask's. Scores are of the object
rendered alone, and of its share of the whole scene, where what stands before it hides it. If --masks holds a folder of
masks for each of several objects, RESULT may hold several, too: each true one is compared with the one that is most
like it. Published data sets have commands of their own, such as evaluate nvos, and evaluate removal measures the scene
without the object."""
EXAMPLES = (
    "gaussian-trimmer evaluate scene.ply trimmed --masks test_masks --cameras sparse/0",
    "gaussian-trimmer evaluate scene.ply object.ply --before rough.npy --masks test_masks --cameras sparse/0",
    "gaussian-trimmer evaluate scene.ply labels.npz --masks masks_of_objects --cameras sparse/0",
)
ABOUT_REMOVAL = """Compare the scene without an object with pictures of it, where the object was.

RESULT is a folder that `trim` wrote, or any splat file of the scene without the object. A picture or mask belongs to
the camera whose picture has the same name; a view counts if it has both. Compared are the pixels of the mask, grown,
without those of other objects."""


def add_arguments(parser: Parser) -> None:
    """Say what `evaluate`, or `evaluate removal`, takes."""
    if parser.command == "evaluate removal":
        _add_removal(parser)
        return
    parser.describe(ABOUT, lambda arguments: publish_as(arguments, _measure), EXAMPLES)
    parser.add_argument("scene", kind=Path, metavar="SCENE", help="Splat file of the scene")
    result = "What to score: a folder of `trim`, a splat file of the object, or a selection file"
    parser.add_argument("result", kind=Path, metavar="RESULT", help=result)
    masks = "Folder of ground-truth masks, in which the object is bright, or of a folder of them for each object"
    add_views(parser, masks, "Folder of the photographs of the masked views, for the extraction PSNR")
    before = "Selection or object before the trim; a folder of `trim` holds it already"
    parser.add_argument("--before", kind=Path, metavar="FILE", help=before)
    objects = "Of several objects, which ones of RESULT count; without it, all"
    parser.add_argument("--objects", kind=tuple[int, ...], metavar="ID ...", help=objects)
    add_rules(parser)
    parser.add_settings(parser, selection=SelectionOptions)
    add_tables(parser)


def _add_removal(parser: Parser) -> None:
    parser.describe(ABOUT_REMOVAL, lambda arguments: publish_as(arguments, _measure_removal))
    parser.add_argument("result", kind=Path, metavar="RESULT", help="What is measured")
    without = "Folder of pictures of the scene without the object"
    parser.add_argument("--without", kind=Path, metavar="DIR", required=True, help=without)
    inpainted = "Folder of photographs with the object, to compare with: OpenCV's inpainting of each"
    add_views(parser, "Folder of masks of the object in these views; the object is bright", inpainted)
    grow = "By how many pixels the masks are grown"
    parser.add_argument("--grow", kind=Annotated[int, Range(0, 100)], default=6, help=grow)
    add_tables(parser)


def add_views(parser: Parser, masks: str, images: str) -> None:
    """Add masks and their cameras, photographs, and what does not count."""
    parser.add_argument("--masks", kind=Path, metavar="DIR", required=True, help=masks)
    cameras = "Cameras of the masks: a COLMAP folder, transforms.json or cameras.json"
    parser.add_argument("--cameras", kind=Path, required=True, help=cameras)
    parser.add_argument("--images", kind=Path, metavar="DIR", help=images)
    ignore = "Folders of masks of pixels that do not count, such as those where others stand before the object"
    parser.add_argument("--ignore", kind=tuple[Path, ...], metavar="DIR ...", help=ignore)
    parser.add_argument("--trust-paths", kind=bool, help=TRUST)


def add_rules(parser: Parser) -> None:
    """Add the rules of a comparison with ground truth."""
    threshold = "Opacity above which a rendered pixel belongs to the object"
    parser.add_argument("--threshold", kind=Share, default=THRESHOLD, help=threshold)
    clip = "Also score the object's look by CLIP-IQA, with this CLIP model: a folder, or a name on the Hugging Face hub"
    parser.add_argument("--clip", metavar="MODEL", help=clip)


def judge_of(arguments: Namespace) -> Judge:
    """Return a judge by these rules; InputError if what it needs is missing."""
    return Judge(arguments.threshold, ClipScorer(arguments.clip) if arguments.clip else None)


def add_tables(parser: Parser) -> None:
    """Add where tables go."""
    group = parser.add_argument_group("tables")
    formats = Literal["table", "csv", "latex"]
    group.add_argument("--format", kind=formats, default="table", help="How to print tables")
    group.add_argument("--output", kind=Path, metavar="DIR", help="Also write all tables here, in every format")
    group.add_argument("--overwrite", kind=bool, help="Replace earlier results in the output folder")
    add_printing(group)


def publish_as(arguments: Namespace, measure: Callable[[Namespace], Findings]) -> None:
    """Publish what is measured, as arguments say."""
    names = ("format", "json", "output", "overwrite", "quiet")
    publish(lambda: measure(arguments), **{name: getattr(arguments, name) for name in names})


def publish(
    measure: Callable[[], Findings],
    *,
    format: str = "table",
    json: bool = False,
    output: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Measure, print the tables, and write them if there is a folder, which then appears whole or not at all.

    Raises:
        InputError: the folder cannot be written to or may not be replaced, which is found before anything is measured;
            or what `measure` raises.
    """
    with atomic_folder(output, "evaluate", overwrite=overwrite) if output else nullcontext() as folder:
        tables, runs, settings = measure()
        if json:
            found = [table.as_dict() for table in tables.values()]
            text = dumps(found if len(found) > 1 else found[0], indent=1, allow_nan=False)
        else:  # where CSV is printed, the notes are only in the files
            text = "\n".join(table.text(format).rstrip("\n") + "\n" for table in tables.values())
        open_console(quiet=quiet).print(text)
        if folder is not None:
            write_tables(tables, runs, settings, folder)


def _measure(arguments: Namespace) -> Findings:
    judge, scene = judge_of(arguments), formats.read(arguments.scene)
    cameras = read_cameras_of(arguments.scene, arguments.cameras, trust_paths=arguments.trust_paths).pinhole_cameras()
    title = f"{clip_name(arguments.result.name)} in {clip_name(arguments.scene.name)}"
    folders = folders_in(arguments.masks)
    if folders and not any(find_mask(arguments.masks, camera) for camera in cameras):
        return {"scores": _several(arguments, scene, cameras, folders, title)}, (), {}
    if arguments.objects:
        raise InputError("--objects is for several objects, each with a folder of masks in --masks.")
    found, views = views_in(cameras, arguments.masks, arguments.images, arguments.ignore)
    result = read_result(arguments.result, scene, selection_options_of(arguments))
    before = _before(arguments, result, scene)
    rows: list[tuple[str, Scores, Scores]] = []
    for view in views:
        then = judge.score_views(before, [view])[0] if before else {}
        rows.append((clip_name(view.camera.name), then, judge.score_views(result, [view], scene)[0]))
    if not any("iou" in now for _, _, now in rows):
        raise InputError(
            f"No mask in '{arguments.masks}' shows the object where pixels count; give masks in which it is bright."
        )
    hidden = sum("iou" not in now for _, _, now in rows)
    rows.append(("mean", mean_scores(then for _, then, _ in rows), mean_scores(now for _, _, now in rows)))
    metrics = known_metrics(rows[-1][2])
    cells = [[name, *score_cells(metrics, then or None, now)] for name, then, now in rows]
    what = "mask and a picture" if arguments.images else "mask"
    notes = [judge.describe(), _views(found, cameras, what) + _ignored(arguments), MADE_BY]
    if hidden:
        notes.append(f"views that show nothing of the object, which count for the accuracy alone: {hidden}")
    if result.unknown:
        notes.append(f"without scores in scene and fidelity, which need the background: {result.unknown}")
    of_rules = {rule: [f"iou{ending}"] for rule, ending in RULES.items() if f"iou{ending}" in rows[-1][2]}
    names = clip_name(arguments.scene.stem), clip_name(arguments.result.stem)
    runs = [Run(*names, "", "", len(found), *rows[-1][1:], 0.0, "")]
    for_papers = table_of_methods(title, {names[1]: runs}, of_rules, notes)
    table = ScoreTable(title, ["view", *map(heading, metrics)], cells, notes, for_papers=for_papers)
    return {"scores": table}, (), {}


def _before(arguments: Namespace, result: Cut, scene: Gaussians) -> Cut | None:
    if arguments.before is not None:
        return read_result(arguments.before, scene, selection_options_of(arguments))
    if result.before is not None:
        return cut_by(scene, result.before)
    if arguments.result.is_dir():
        raise InputError(
            f"'{arguments.result}' does not say which Gaussians were selected before the trim; give the selection with "
            "--before FILE."
        )
    return None


def _several(
    arguments: Namespace, scene: Gaussians, cameras: Sequence[Camera], folders: Sequence[Path], title: str
) -> ScoreTable:
    """Return a row for each of several true objects, which have a folder of masks each."""
    if arguments.images or arguments.ignore or arguments.before or arguments.clip or arguments.threshold != THRESHOLD:
        raise InputError(
            f"--images, --ignore, --before, --clip and --threshold are for one object; '{arguments.masks}' has "
            "a folder of masks for each of several."
        )
    masks = [{camera.name: path for camera, path in find_masks(cameras, folder)} for folder in folders]
    views = [camera for camera in cameras if any(camera.name in paths for paths in masks)]
    file = arguments.result / "labels.npz" if arguments.result.is_dir() else arguments.result
    labels = load_objects(file, scene, arguments.objects, selection_options_of(arguments))
    numbers = [int(number) for number in (arguments.objects or np.unique(labels[labels > 0]))]
    found = [np.asarray(labels == number) for number in numbers]
    ious, rows = 100 * ious_of(shared_pixels(scene, found, _truths(views, masks))), list[list[Cell]]()
    for folder, of_true in zip(folders, ious, strict=True):
        number = numbers[int(of_true.argmax())] if of_true.any() else None
        rows.append([clip_name(folder.name), number, float(of_true.max(initial=0))])
    rows.append(["mean", None, float(ious.max(axis=1, initial=0).mean())])
    notes = ["IoU with the object that is most like it, over the pixels of all views together"]
    return ScoreTable(
        title, ["true object", "found as", "IoU (%)"], rows, [*notes, _views(views, cameras, "mask"), MADE_BY]
    )


def _truths(
    cameras: Sequence[Camera], masks: Sequence[Mapping[str, Path]]
) -> Iterator[tuple[Camera, list[FloatArray]]]:
    """Yield the cameras at the size of their masks, and the coverage of each true object."""
    for camera in cameras:
        found = [view_of(camera, path) if (path := paths.get(camera.name)) else None for paths in masks]
        first = next(view for view in found if view is not None)
        coverages = [view.coverage if view else np.zeros_like(first.coverage) for view in found]
        if any(coverage.shape != first.coverage.shape for coverage in coverages):
            raise InputError(
                f"The masks of the picture '{clip_name(camera.name)}' differ in size; they must have the same."
            )
        yield first.camera, coverages


def _views(found: Sequence[Camera], cameras: Sequence[Camera], what: str) -> str:
    return f"views: {len(found)}, those of {len(cameras)} cameras with a {what}; mean over views"


def _ignored(arguments: Namespace) -> str:
    return f", where no mask to ignore exceeds {IGNORED:g}" if arguments.ignore else ""


def _measure_removal(arguments: Namespace) -> Findings:
    background = read_background(arguments.result)
    cameras = read_cameras_of(arguments.result, arguments.cameras, trust_paths=arguments.trust_paths).pinhole_cameras()
    check_folders(arguments.images)
    pictured = [camera for camera, _ in find_masks(cameras, arguments.without)]
    found, views = views_in(pictured, arguments.masks, arguments.without, arguments.ignore)
    rows: list[list[Cell]] = []
    for view in views:
        assert view.image is not None, "views without the object have their picture"
        region = grown(view.coverage > THRESHOLD, arguments.grow)
        pictures, counted = [render(background, view.camera).rgb], region & view.counted
        if arguments.images is not None:
            size = view.camera.width, view.camera.height
            pictures.append(inpaint(read_photograph(find_picture(arguments.images, view.camera), *size), region))
        scores = [likeness(picture, view.image, counted) or (None, None) for picture in pictures]
        rows.append([clip_name(view.camera.name), int(np.count_nonzero(counted)), *(c for s in scores for c in s)])
    numbers = [[cell for cell in column if isinstance(cell, float)] for column in zip(*rows, strict=True)]
    rows.append(["mean", None, *(float(np.mean(column)) if column else None for column in numbers[2:])])
    names = ["PSNR (dB)", "SSIM", *(["inpainting, PSNR (dB)", "inpainting, SSIM"] if arguments.images else [])]
    notes = [
        f"pixels of the object's mask > 0.5, grown by {arguments.grow}{_ignored(arguments)}",
        _views(found, cameras, "picture and a mask"),
        "SSIM in a window of 11 pixels",
        *([f"inpainting: OpenCV's after Telea, radius {INPAINT_RADIUS:g}"] if arguments.images else []),
        MADE_BY,
    ]
    title = f"{clip_name(arguments.result.name)}: the scene without the object, where it was"
    return {"removal": ScoreTable(title, ["view", "pixels", *names], rows, notes, digits=3)}, (), {}
