"""All that a trim leaves on disk, for the command line and for `TrimResult.save`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import IntArray
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.html.report_page import REPORT, write_report_page
from gaussian_trimmer.output.report import RESULTS, describe, result_files, write_results
from gaussian_trimmer.result import TrimResult


def save(
    result: TrimResult, folder: str | Path, *, overwrite: bool = False, format: str | None = None, html: bool = False
) -> Path:
    """Write a trim into a folder, which appears whole or not at all; returns the folder. See `TrimResult.save`."""
    folder, suffix = Path(folder), suffix_of(format or "ply")
    with atomic_folder(folder, RESULTS, names=trim_files(suffix, html=html), overwrite=overwrite) as part:
        write_trim(result, part, suffix, {}, html=html)
    return folder


def write_trim(
    result: TrimResult, folder: Path, suffix: str, inputs: Mapping[str, Any],
    seconds: Mapping[str, float] | None = None, rows: IntArray | None = None, n_scene: int | None = None, *,
    html: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Write everything into an existing folder, and return the report.

    Args:
        result: the trim.
        folder: where to write.
        suffix: ending of the splat files, one of `formats.FORMATS`.
        inputs: where the scene, the selection and so on came from, as JSON holds it.
        seconds: time taken outside the trimmer, by stage.
        rows: row in the original scene of each Gaussian of the result's scene, where that is what an earlier trim left.
        n_scene: number of Gaussians of that original scene.
        html: write `report.html` too, a page to look at.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    report = describe(result, result.selection, result.config, inputs, result.segmenter_description, seconds)
    write_results(result, result.selection, report, folder, result.used_renderer, suffix, rows, n_scene)
    if html:
        write_report_page(result, report, folder)
    return report


def trim_files(suffix: str, *, html: bool) -> tuple[str, ...]:
    """Patterns of the names that `write_trim` writes."""
    return (*result_files(suffix), *([REPORT] if html else []))


def suffix_of(format: str) -> str:
    """The ending of files of a format, whose name may be given with or without a leading dot.

    Raises:
        InputError: no format has that name.

    >>> suffix_of("Compressed.PLY")
    '.compressed.ply'
    """
    suffix = f".{format.lower().lstrip('.')}"
    if suffix not in formats.FORMATS:
        known = ", ".join(name.lstrip(".") for name in formats.FORMATS)
        raise InputError(f"Unknown format '{format}'; available: {known}.")
    return suffix
