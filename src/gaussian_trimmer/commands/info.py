"""`gaussian-trimmer info`: what files and folders are, in words."""

from __future__ import annotations

import shlex
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set, read_cameras_of
from gaussian_trimmer.cameras import check_facing
from gaussian_trimmer.commands.arguments import LEVEL, TRUST
from gaussian_trimmer.commands.console import add_printing, console_of, print_json
from gaussian_trimmer.errors import InputError, clip_name, printable
from gaussian_trimmer.formats.identify import FORMATS, SELECTION_SUFFIXES, STREAMED, Identity, identify
from gaussian_trimmer.formats.streamed_sog import open_streamed
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry.limits import lost_places
from gaussian_trimmer.io.reading import is_file, read_json
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.selecting.marks import KINDS, read_marks
from gaussian_trimmer.selection_files import SelectionOptions, arrays_that_select, offered_kinds
from gaussian_trimmer.selection_files.kinds import LABEL_NAMES, MASK, count_ids, list_ids, list_names
from gaussian_trimmer.selection_files.method_kinds import classifier_of
from gaussian_trimmer.selection_files.row_matching import has_identity_features
from gaussian_trimmer.selection_files.selection_file import SelectionFile, flag, open_selection

ABOUT = "Say what splat files, selections and camera files hold, and how a selection can be used."
_FAINT_OPACITY, _SOLID_OPACITY = 0.05, 0.95
_MAX_LISTED = 24
_FEATURES = f"selects with {flag('classifier')} and {flag('object_id')}, or with {flag('query_row')}"
_USES_BY_KIND = {
    "trimmed": f"labels of a trim: selects its object, or one of several with {flag('object_id')}",
    "mask": "selects from a scene of {n} Gaussians",
    "labels": f"selects from a scene of {{n}} Gaussians, with {flag('object_id')}",
    "indices": "selects the listed rows",
    "flashsplat": f"selects from a scene of {{n}} Gaussians by FlashSplat's weights, with {flag('object_id')}",
    "classifier": f"selects from a scene with obj_dc columns, with {flag('object_id')}",
}


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run)
    parser.add_argument("files", kind=tuple[Path, ...], metavar="FILE ...", help="Files, or folders with cameras")
    parser.add_argument("--level", kind=int, metavar="N", help=LEVEL)
    parser.add_argument("--trust-paths", kind=bool, help=TRUST)
    add_printing(parser)


def run(arguments: Namespace) -> None:
    """Print a paragraph on every file.

    Raises:
        InputError: a file is missing, of no known kind, or damaged.
    """
    console, files = console_of(arguments), list[dict[str, Any]]()
    for path in arguments.files:
        facts = dict[str, Any]()
        said = describe_file(path, level=arguments.level, trust_paths=arguments.trust_paths, facts=facts)
        console.print(said)
        files.append({"file": str(path), "said": said, **facts})
    scenes, cameras = ([p for p in arguments.files if identify(p).kind == kind] for kind in ("splats", "cameras"))
    if len(scenes) == 1 and cameras:
        means = formats.read(scenes[0], level=arguments.level, say=lambda text: None).means
        for path in cameras:
            try:
                taken = read_cameras_of(scenes[0], path, trust_paths=arguments.trust_paths, say=lambda text: None)
                check_facing(taken, means)
            except InputError as wrong:
                console.print(f"{path}, for {scenes[0]}: {wrong}")
                files.append({"file": str(path), "said": str(wrong)})
    print_json(arguments, {"files": files})


def describe_file(
    path: Path, *, level: int | None = None, trust_paths: bool = False, facts: dict[str, Any] | None = None
) -> str:
    """Return several lines on a file or folder.

    Args:
        path: the file or folder.
        level: level of detail, where there are some; None: the finest that memory allows.
        trust_paths: as for `read_camera_set`.
        facts: takes what programs ask of a splat file, as JSON holds it.

    Raises:
        InputError: it is missing, of no known kind, or damaged.
    """
    found, facts = identify(path), {} if facts is None else facts
    if not path.exists():
        raise InputError(f"There is no file or folder '{path}'.")
    match found.kind:
        case "results":
            lines = _result_lines(path)
        case "folder":
            lines = _folder_lines(found, level, trust_paths, facts)
        case "splats":
            lines = _splat_lines(path, level, facts)
        case "marks":
            lines = _mark_lines(path)
        case "project":
            lines = iter(["project of the app: open it with 'gaussian-trimmer view'"])
        case "cameras":
            lines = _camera_lines(path, trust_paths)
        case "array" | "torch":
            lines = _selection_lines(open_selection(path), facts)
        case "unknown":
            known = ", ".join(dict.fromkeys((*FORMATS, *SELECTION_SUFFIXES)))
            raise InputError(f"'{path.name}' is of an unknown kind; known endings: {known}, and folders of cameras.")
    size = f" ({path.stat().st_size / 1e6:.3g} MB)" if is_file(path) else ""
    return "\n  ".join(printable(line) for line in [f"{path}{size}", *lines])


def _folder_lines(found: Identity, level: int | None, trust_paths: bool, facts: dict[str, Any]) -> Iterator[str]:
    """Give lines on the scene of a training, else on cameras, and on what segmentation methods left beside."""
    path, scene, uses = found.path, "SCENE", list[str]()
    try:
        scene = str(found.scene)
    except InputError as no_scene:
        uses = list(_uses_of_folder(found, scene))
        try:
            yield from _camera_lines(path, trust_paths)
        except InputError as no_cameras:
            if not uses:
                raise InputError(f"{no_scene} {no_cameras}") from no_cameras
    else:
        yield f"scene: {found.scene.relative_to(path)}"
        yield from _splat_lines(found.scene, level, facts)
    yield from uses or _uses_of_folder(found, scene)


def _uses_of_folder(found: Identity, scene: str) -> Iterator[str]:
    """Give lines on the selections that methods left in a folder, with the commands that use them."""
    folder, selections = found.path, found.selections
    cameras = ["--cameras", str(folder / "cameras.json")] if (folder / "cameras.json").is_file() else []
    for path, kind in selections[:_MAX_LISTED]:
        own = str(path) if kind.own_scene else scene
        yield f"selection of {kind.method}: {path.relative_to(folder)}"
        yield f"  {shlex.join(['gaussian-trimmer', 'trim', own, str(path), *kind.needs.split(), *cameras])}"
    yield from _more(selections, "selections")
    for prompt in sorted({path.name for path in folder.glob("*/chosen_*.png")})[:_MAX_LISTED]:
        yield f"masks of LangSplat: */{prompt}"
        masks = shlex.quote(f"{folder}/*/{prompt}")
        yield f"  gaussian-trimmer select SCENE --masks {masks} --cameras PATH --trim DIR"


def _result_lines(folder: Path) -> Iterator[str]:
    report = read_json(folder / "report.json")
    inputs = report.get("inputs") if isinstance(report, dict) else None
    scene = inputs.get("scene") if isinstance(inputs, dict) else None
    yield f"results of a trim{f' of {clip_name(str(scene))}' if scene else ''}"
    for path in sorted(folder.iterdir()):
        if identify(path).kind == "splats":
            yield f"{path.name}: {len(formats.read(path)):,} Gaussians"
    option = "" if isinstance(report, dict) and len(report.get("objects", ())) == 1 else "--labels "
    labels = option + shlex.quote(str(folder / "labels.npz"))
    yield f"labels.npz selects in the scene what was trimmed: gaussian-trimmer trim SCENE {labels}"


def _splat_lines(path: Path, level: int | None, facts: dict[str, Any]) -> Iterator[str]:
    """Give lines on a splat file, and on all of its levels of detail."""
    said: list[str] = []
    if path.name.lower() == STREAMED:
        streamed = open_streamed(path)
        for number, rows in streamed.levels.items():
            missing = streamed.missing(rows)
            lacks = f", {len(missing)} of which are missing, such as {clip_name(missing[0])}" if missing else ""
            yield f"level {number}: {len(rows):,} Gaussians in {len(streamed.chunks_of(rows))} chunks{lacks}"
        chosen = streamed.choose_level(level)
        if streamed.missing(streamed.levels[chosen]):
            return
        said.append(f"read: {streamed.describe(chosen)}")
    yield from (*said, *_gaussian_lines(formats.read(path, level=level, say=lambda note: None), facts))


def _gaussian_lines(gaussians: Gaussians, facts: dict[str, Any]) -> Iterator[str]:
    """Give lines on counts, bounds, opacities, sizes and extra columns, and on the selections that these offer."""
    seen = formats.without_blank(gaussians)
    low, high = np.percentile(seen.means, [1, 99], axis=0)
    facts |= {
        "gaussians": len(gaussians),
        "sh_degree": gaussians.sh_degree,
        "bounds_of_98_percent": [low.tolist(), high.tolist()],
        "extra_columns": list(gaussians.extras),
        "notes": list(gaussians.notes),
    }
    yield f"splats: {len(gaussians)} Gaussians, SH degree {gaussians.sh_degree}"
    yield from gaussians.notes
    ranges = (f"{axis} {low[i]:.3g} to {high[i]:.3g}" for i, axis in enumerate("xyz"))
    yield f"bounds of the middle 98 %: {', '.join(ranges)}"
    opacities = seen.opacities
    faint, solid = 100 * np.mean(opacities < _FAINT_OPACITY), 100 * np.mean(opacities > _SOLID_OPACITY)
    yield (
        f"opacity: median {np.median(opacities):.2f}, {faint:.0f} % below {_FAINT_OPACITY}, {solid:.0f} % above "
        f"{_SOLID_OPACITY}"
    )
    with np.errstate(over="ignore"):
        largest = np.exp(seen.largest_log_scales.astype(np.float64))
    yield f"largest standard deviation: median {np.median(largest):.3g}, maximum {largest.max():.3g}"
    if gaussians.antialiased:
        yield "antialiased: drawn with opacities that make up for the pixels' blur"
    if gaussians.model == "2dgs":
        yield "discs of 2D Gaussian Splatting: as thick as a thousandth of their smaller width"
    if far := lost_places(gaussians):
        yield f"coordinates have lost digits: {far}"
    if names := list(gaussians.extras):
        yield f"extra columns: {list_names(names)}"
        if has_identity_features(names):
            yield f"identity features: {_FEATURES}"
        if MASK in names:
            yield f"property {MASK}: selects the rows where it is positive, as SA3D-GS does"
        elif any(not name.startswith("obj_dc_") for name in names):
            yield f"selects by a column, with {flag('property')} and {flag('threshold')} or {flag('object_id')}"


def _mark_lines(path: Path) -> Iterator[str]:
    marks, names = read_marks(path), {kind: name for name, kind in KINDS.items()}
    yield f"marks: {len(marks.marks)}, in a scene of {marks.scene_size or 'unknown'} Gaussians"
    for number, mark in enumerate(marks.marks[:_MAX_LISTED], 1):
        effect = getattr(mark, "effect", None)
        yield f"{number}. {names[type(mark)]}{f', {effect}' if effect else ''}"
    yield from _more(marks.marks, "marks")
    yield "selects: give the file as SELECTION of trim, or to select --marks"


def _selection_lines(file: SelectionFile, facts: dict[str, Any]) -> Iterator[str]:
    """Give lines on what the arrays or the checkpoint of a selection file hold, and how they can be used."""
    if (checkpoint := file.checkpoint) is not None:
        iteration = "" if checkpoint.iteration is None else f" of iteration {checkpoint.iteration}"
        yield f"training checkpoint{iteration}, which can be the scene"
        yield from _gaussian_lines(checkpoint.gaussians, facts)
        if checkpoint.logits is not None:
            yield "selects the Gaussians with COB-GS's foreground probability above 0.9"
        elif not file.has_features:
            yield "holds no selection"
        return
    if (classifier := classifier_of(file)) is not None:
        yield "classifier of {} ids from {} identity features".format(*classifier[0].shape)
        yield _USES_BY_KIND["classifier"]
        return
    for name, array in list(file.arrays.items())[:_MAX_LISTED]:
        yield f"{f'array {clip_name(name)}' if name else 'array'}: {array.dtype} {array.shape}, {_values(array)}"
    yield from _more(file.arrays, "arrays")
    options = SelectionOptions()
    labels = file.vector(options, *LABEL_NAMES)
    longest = max((max(array.shape, default=0) for array in file.arrays.values()), default=0)
    n = longest if labels is None else len(labels)
    kinds = offered_kinds(file, n, options)
    for kind in kinds:
        yield _USES_BY_KIND[kind].format(n=n)
    rows = file.vector(options)
    if "labels" in kinds and rows is not None and rows.min(initial=0) >= 0 and len(np.unique(rows)) == len(rows):
        yield "selects the listed rows of a scene with more Gaussians"
    if not kinds:
        by_name = arrays_that_select(file, n, options)
        named = f"selects from a scene of {n} Gaussians by one of these arrays, with {flag('property', 'NAME')}"
        yield named if by_name else "holds no selection of a known kind"


def _camera_lines(path: Path, trust_paths: bool) -> Iterator[str]:
    found = read_camera_set(path, trust_paths=trust_paths)
    yield f"cameras: {len(found.cameras)} views ({sum(found.train)} for training)"
    sizes = sorted({(camera.width, camera.height) for camera in found.cameras})
    more = f" and {len(sizes) - 3} more sizes" if len(sizes) > 3 else ""
    yield f"images: {', '.join(f'{width} x {height}' for width, height in sizes[:3])}{more}"
    if found.up is not None:
        yield f"up: {', '.join(f'{value:.3g}' for value in found.up)}"
    if found.distorted:
        yield "the lens distorts: poses can be used, pixels of the images cannot before they are undistorted"


def _values(array: NDArray[Any]) -> str:
    if array.size == 0:
        return "empty"
    if array.dtype.kind == "b":
        return f"{int(array.sum())} true"
    if array.dtype.kind == "f":
        return f"{array.min():g} to {array.max():g}"
    ids, counts = count_ids(array)
    # Row numbers are all different: a list of them says nothing.
    return f"{array.min()} to {array.max()}" + (f": {list_ids(ids, counts)}" if len(ids) < array.size else "")


def _more(listed: Any, what: str) -> Iterator[str]:
    if len(listed) > _MAX_LISTED:
        yield f"and {len(listed) - _MAX_LISTED} more {what}"
