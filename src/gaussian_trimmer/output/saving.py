"""All that a trim leaves on disk, for the command line and for Python."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.html.report_page import REPORT, write_report_page
from gaussian_trimmer.output.report import RESULTS, describe, result_files, write_results
from gaussian_trimmer.result import TrimResult


def save(
    result: TrimResult, folder: str | Path, *, overwrite: bool = False, format: str | None = None, html: bool = False
) -> Path:
    """Write what the command line writes, and return the folder, which appears whole or not at all.

    That is object and background as splat files, `labels.npz`, `report.json`, `before_after.png` and `views/`. An
    empty background is not written.

    Args:
        result: the trim.
        folder: new or empty; missing parents are made.
        overwrite: replace earlier results in the folder.
        format: ending of the splat files: ply (the default), compressed.ply, splat, spz, sog or ksplat.
        html: also write `report.html`, a page about the trim that any browser opens.

    Raises:
        InputError: the folder holds something and `overwrite` is not set, it cannot be written to, no format has
            that name, or the format cannot hold the Gaussians.
    """
    folder, suffix = Path(folder), suffix_of(format or "ply")
    with atomic_folder(folder, RESULTS, names=trim_files(suffix, html=html), overwrite=overwrite) as part:
        write_trim(result, part, suffix, html=html)
    return folder


def write_trim(
    result: TrimResult,
    folder: Path,
    suffix: str,
    inputs: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    *,
    html: bool = False,
) -> dict[str, Any]:
    """Write everything into an existing folder, and return the report.

    Args:
        result: the trim.
        folder: where to write.
        suffix: ending of the splat files, one of `formats.FORMATS`.
        inputs: where the scene, the selection and so on came from, as JSON holds it.
        seconds: time taken outside the trimmer, by stage.
        html: also write `report.html`.

    Raises:
        InputError: a file cannot be written, or the format cannot hold the Gaussians.
    """
    report = describe(result, inputs, seconds)
    write_results(result, report, folder, suffix)
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
