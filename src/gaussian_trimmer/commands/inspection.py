"""What a file is, in words: splats, selections and cameras, for `gaussian-trimmer info`."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.errors import InputError, clip_name, printable
from gaussian_trimmer.formats import torch_files
from gaussian_trimmer.formats.checkpoints import Checkpoint
from gaussian_trimmer.formats.packing import are_discs
from gaussian_trimmer.formats.streamed_sog import open_streamed
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import is_file, is_folder, read_json
from gaussian_trimmer.selecting.marks import KINDS, Marks
from gaussian_trimmer.selecting.marks_file import is_marks_file, read_marks
from gaussian_trimmer.selection_files import SelectionOptions, arrays_that_select, offered_kinds
from gaussian_trimmer.selection_files.feature_kinds import classifier_of
from gaussian_trimmer.selection_files.kinds import LABEL_NAMES, MASK
from gaussian_trimmer.selection_files.labels import count_ids, list_ids, list_names
from gaussian_trimmer.selection_files.method_files import method_files_in
from gaussian_trimmer.selection_files.row_matching import has_identity_features
from gaussian_trimmer.selection_files.selection_file import SUFFIXES, SelectionFile, flag, open_selection

_FAINT_OPACITY, _SOLID_OPACITY = 0.05, 0.95
_MAX_LISTED = 24
_COLMAP_FILES = ("cameras.bin", "cameras.txt", "images.bin", "images.txt")
_USES_BY_KIND = {
    "trimmed": f"labels of a trim: selects its object, or one of several with {flag('object_id')}",
    "mask": "selects from a scene of {n} Gaussians",
    "labels": f"selects from a scene of {{n}} Gaussians, with {flag('object_id')}",
    "indices": "selects the listed rows",
    "flashsplat": f"selects from a scene of {{n}} Gaussians by FlashSplat's weights, with {flag('object_id')}",
}


def describe_file(
    path: Path, *, level: int | None = None, trust_paths: bool = False, facts: dict[str, Any] | None = None
) -> str:
    """Return several lines on a splat file, a selection file, or a file or folder of cameras.

    Arguments:
        path: the file or folder.
        level: level of detail, where there are some; None: the finest that memory allows.
        trust_paths: as for `read_camera_set`.
        facts: takes what programs ask of a splat file, as JSON holds it.

    Raises:
        InputError: the file is missing, of no known kind, or damaged.
    """
    if not (is_file(path) or is_folder(path)):
        raise InputError(f"There is no file or folder '{path}'.")
    name = path.name.lower()
    if is_folder(path):
        lines = describe_folder(path, level=level, trust_paths=trust_paths)
    elif is_marks_file(path):
        lines = describe_marks(read_marks(path))
    elif formats.has_splats(path) and path.suffix.lower() not in torch_files.SUFFIXES:
        lines = describe_splats(path, level, facts)
    elif path.suffix.lower() == ".json" or name in _COLMAP_FILES:
        lines = describe_cameras(path, trust_paths=trust_paths)
    elif name.endswith(SUFFIXES):
        lines = describe_selection(open_selection(path))
    else:
        known = ", ".join(dict.fromkeys((*formats.FORMATS, *SUFFIXES, ".json")))
        raise InputError(f"'{path.name}' is of an unknown kind; known endings: {known}, and folders of cameras.")
    return "\n  ".join(printable(line) for line in [f"{path}{_size(path)}", *lines])


def describe_folder(path: Path, *, level: int | None = None, trust_paths: bool = False) -> Iterator[str]:
    """Give lines on the results of a trim or the scene of a training that a folder holds, or else on its cameras.

    Raises:
        InputError: it holds nothing of these.
    """
    if (path / "labels.npz").is_file() and (path / "report.json").is_file():
        yield from describe_results(path)
        return
    scene, uses = None, []
    try:
        scene = formats.find_scene(path)
    except InputError as no_scene:
        uses = list(uses_of_folder(path, None))
        try:
            yield from describe_cameras(path, trust_paths=trust_paths)
        except InputError as no_cameras:
            if not uses:
                raise InputError(f"{no_scene} {no_cameras}") from no_cameras
    else:
        yield f"scene: {scene.relative_to(path)}"
        yield from describe_splats(scene, level)
        uses = list(uses_of_folder(path, scene))
    yield from uses


def describe_results(folder: Path) -> Iterator[str]:
    """Give lines on a folder that a trim wrote."""
    report = read_json(folder / "report.json")
    inputs = report.get("inputs") if isinstance(report, dict) else None
    scene = inputs.get("scene") if isinstance(inputs, dict) else None
    yield f"results of a trim{f' of {clip_name(str(scene))}' if scene else ''}"
    for path in sorted(folder.iterdir()):
        if is_file(path) and formats.has_splats(path):
            yield f"{path.name}: {len(formats.read(path)):,} Gaussians"
    option = "--labels " if isinstance(report, dict) and "objects" in report else ""
    labels = option + shlex.quote(str(folder / "labels.npz"))
    yield f"labels.npz selects in the scene what was trimmed: gaussian-trimmer trim SCENE {labels}"


def uses_of_folder(folder: Path, scene: Path | None) -> Iterator[str]:
    """Give lines on the selections that segmentation methods left in a folder, with the commands that use them.

    Args:
        folder: the folder.
        scene: the splat file in it, if it has one.
    """
    found = list(method_files_in(folder))
    cameras = ["--cameras", str(folder / "cameras.json")] if (folder / "cameras.json").is_file() else []
    for path, kind in found[:_MAX_LISTED]:
        own = str(path if kind.own_scene else scene or "SCENE")
        yield f"selection of {kind.method}: {path.relative_to(folder)}"
        yield f"  {shlex.join(['gaussian-trimmer', 'trim', own, str(path), *kind.needs.split(), *cameras])}"
    if len(found) > _MAX_LISTED:
        yield f"and {len(found) - _MAX_LISTED} more selections"
    for prompt in sorted({path.name for path in folder.glob("*/chosen_*.png")})[:_MAX_LISTED]:
        masks = shlex.quote(f"{folder}/*/{prompt}")
        yield f"masks of LangSplat: */{prompt}"
        yield f"  gaussian-trimmer select SCENE --masks {masks} --cameras PATH --trim DIR"


def describe_splats(path: Path, level: int | None = None, facts: dict[str, Any] | None = None) -> Iterator[str]:
    """Give lines on a splat file, and on all of its levels of detail; `facts` is as for `describe_file`."""
    said: list[str] = []
    if path.name.lower() == formats.STREAMED:
        streamed = open_streamed(path)
        for number, rows in streamed.levels.items():
            missing = streamed.missing(rows)
            lacks = f", {len(missing)} of which are missing, such as {clip_name(missing[0])}" if missing else ""
            yield f"level {number}: {len(rows):,} Gaussians in {len(streamed.chunks_of(rows))} chunks{lacks}"
        chosen = streamed.choose_level(level)
        if streamed.missing(streamed.levels[chosen]):
            return
        said.append(f"read: {streamed.describe(chosen)}")
    yield from (*said, *describe_gaussians(formats.read(path, level=level), facts))


def describe_gaussians(gaussians: Gaussians, facts: dict[str, Any] | None = None) -> Iterator[str]:
    """Lines on counts, bounds, opacities, sizes and extra columns, and on the selections that the columns offer."""
    yield f"splats: {len(gaussians)} Gaussians, SH degree {gaussians.sh_degree}"
    low, high = np.percentile(gaussians.means, [1, 99], axis=0)
    if facts is not None:
        facts |= {
            "gaussians": len(gaussians),
            "sh_degree": gaussians.sh_degree,
            "bounds_of_98_percent": [low.tolist(), high.tolist()],
            "extra_columns": list(gaussians.extras),
        }
    ranges = (f"{axis} {low[i]:.3g} to {high[i]:.3g}" for i, axis in enumerate("xyz"))
    yield f"bounds of the middle 98 %: {', '.join(ranges)}"
    opacities = gaussians.opacities
    yield (
        f"opacity: median {np.median(opacities):.2f}, {_percent(opacities < _FAINT_OPACITY)} below {_FAINT_OPACITY}, "
        f"{_percent(opacities > _SOLID_OPACITY)} above {_SOLID_OPACITY}"
    )
    with np.errstate(over="ignore"):
        largest = np.exp(gaussians.largest_log_scales.astype(np.float64))
    yield f"largest standard deviation: median {np.median(largest):.3g}, maximum {largest.max():.3g}"
    if are_discs(gaussians):
        yield "discs of 2D Gaussian Splatting: as thick as a thousandth of their smaller width"
    if gaussians.extras:
        yield f"extra columns: {list_names(gaussians.extras)}"
        yield from _offers_of_columns(gaussians.extras)


def describe_marks(marks: Marks) -> Iterator[str]:
    """Give lines on marks that were saved."""
    names = {kind: name for name, kind in KINDS.items()}
    yield f"marks: {len(marks.marks)}, in a scene of {marks.scene_size or 'unknown'} Gaussians"
    for number, mark in enumerate(marks.marks[:_MAX_LISTED], 1):
        effect = getattr(mark, "effect", None)
        yield f"{number}. {names[type(mark)]}{f', {effect}' if effect else ''}"
    if len(marks.marks) > _MAX_LISTED:
        yield f"and {len(marks.marks) - _MAX_LISTED} more"
    yield "selects: give the file as SELECTION of trim, or to select --marks"


def describe_selection(file: SelectionFile) -> Iterator[str]:
    """Give lines on what the arrays or the checkpoint of a selection file hold, and how they can be used."""
    if file.checkpoint is not None:
        yield from _checkpoint_lines(file.checkpoint)
        return
    if (classifier := classifier_of(file)) is not None:
        yield f"classifier of {classifier.weight.shape[0]} ids from {classifier.weight.shape[1]} identity features"
        yield f"selects from a scene with obj_dc columns, with {flag('object_id')}"
        return
    for name, array in list(file.arrays.items())[:_MAX_LISTED]:
        yield f"{f'array {clip_name(name)}' if name else 'array'}: {array.dtype} {array.shape}, {_values(array)}"
    if len(file.arrays) > _MAX_LISTED:
        yield f"and {len(file.arrays) - _MAX_LISTED} more arrays"
    options = SelectionOptions()
    labels = file.vector(options, *LABEL_NAMES)
    longest = max((max(array.shape, default=0) for array in file.arrays.values()), default=0)
    n = longest if labels is None else len(labels)
    kinds = offered_kinds(file, n, options)
    for kind in kinds:
        yield _USES_BY_KIND[kind].format(n=n)
    if "labels" in kinds and _distinct_rows(file, options):
        yield "selects the listed rows of a scene with more Gaussians"
    if not kinds:
        by_name = arrays_that_select(file, n, options)
        named = f"selects from a scene of {n} Gaussians by one of these arrays, with {flag('property')} NAME"
        yield named if by_name else "holds no selection of a known kind"


def describe_cameras(path: Path, *, trust_paths: bool = False) -> Iterator[str]:
    """Give lines on the number of cameras, their images, split and up vector."""
    found = read_camera_set(path, trust_paths=trust_paths)
    yield f"cameras: {len(found.cameras)} views ({sum(found.train)} for training)"
    sizes = sorted({(camera.width, camera.height) for camera in found.cameras})
    more = f" and {len(sizes) - 3} more sizes" if len(sizes) > 3 else ""
    yield f"images: {', '.join(f'{width} x {height}' for width, height in sizes[:3])}{more}"
    if found.up is not None:
        yield f"up: {', '.join(f'{value:.3g}' for value in found.up)}"
    if found.distorted:
        yield "the lens distorts: poses can be used, pixels of the images cannot before they are undistorted"


def _checkpoint_lines(checkpoint: Checkpoint) -> Iterator[str]:
    iteration = "" if checkpoint.iteration is None else f" of iteration {checkpoint.iteration}"
    yield f"training checkpoint{iteration}, which can be the scene"
    yield from describe_gaussians(checkpoint.gaussians)
    if checkpoint.logits is not None:
        yield "selects the Gaussians with COB-GS's foreground probability above 0.9"
    elif checkpoint.features is not None:
        width = checkpoint.features.shape[1]
        yield (
            f"{width} identity features a Gaussian: selects with {flag('classifier')} and {flag('object_id')}, or with "
            f"{flag('query_row')}"
        )
    else:
        yield "holds no selection"


def _offers_of_columns(columns: Iterable[str]) -> Iterator[str]:
    names = set(columns)
    if has_identity_features(names):
        yield (
            f"identity features: selects with {flag('classifier')} and {flag('object_id')}, or with {flag('query_row')}"
        )
    if MASK in names:
        yield f"property {MASK}: selects the rows where it is positive, as SA3D-GS does"
    elif any(not name.startswith("obj_dc_") for name in names):
        yield f"selects by one of the columns, with {flag('property')} and {flag('threshold')} or {flag('object_id')}"


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


def _distinct_rows(file: SelectionFile, options: SelectionOptions) -> bool:
    rows = file.vector(options)
    return rows is not None and len(np.unique(rows)) == len(rows) and int(rows.min(initial=0)) >= 0


def _percent(flags: NDArray[np.bool_]) -> str:
    return f"{100 * float(np.mean(flags)):.0f} %"


def _size(path: Path) -> str:
    if is_folder(path):
        return ""
    n_bytes = path.stat().st_size
    return f" ({n_bytes / 1e6:.1f} MB)" if n_bytes >= 1e5 else f" ({n_bytes / 1e3:.1f} kB)"
