"""Gaussians as one page that draws them: any browser opens it, without a server and without the network."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gaussian_trimmer.cameras import up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.splat import ROW, rows_of
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds, robust_bounds
from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.output.checked_sides import checked_sides
from gaussian_trimmer.output.html.document import SUFFIXES, as_markup, asset, document, json_block, render
from gaussian_trimmer.trimming.result import TrimResult

MOST_GAUSSIANS = 1_000_000
"""Gaussians that a page holds at most: 43 MB, opened in some five seconds and sorted in under half of one."""
Part = Literal["object", "background", "both"]
_FOV_RADIANS = float(np.radians(45))
_FILL_SHARE = 0.8
"""Share of the picture's shorter side that the sphere around the bounds fills at first."""
_FIRST_ANGLES = float(np.radians(30)), float(np.radians(20))
"""Yaw and pitch of the first view, in radians, if nothing speaks for others."""
_NEAR_PLANE_RADII = 0.01
"""Distance in radii of the bounds before which nothing is drawn."""
_HELP_TEXT = (
    "Drag to turn; drag with Shift or the right button to move; zoom with the wheel or two fingers. With the picture "
    "focused: arrows turn, Shift and arrows move, + and - zoom, Space keeps turning, Home starts over. Colours are the "
    "same from every side."
)


def export_viewer(result: TrimResult, path: str | Path, part: str = "object", *, overwrite: bool = False) -> None:
    """Write what a trim made as a page that draws it in any browser, without a server and without the network.

    Args:
        result: the trim.
        path: name of the page, which ends with .html.
        part: `object`, `background`, or `both`, of which the page can hide one.
        overwrite: replace the file if it exists.

    Raises:
        InputError: there are more than a million Gaussians, or none; the file exists and `overwrite` is not set; or
            it cannot be written.
    """
    choices = {"object": ("object",), "background": ("background",), "both": ("object", "background")}
    if part not in choices:
        raise InputError(f"Unknown part '{part}' of a trim; available: {', '.join(choices)}.")
    parts = {name: getattr(result, name) for name in choices[part]}
    angles = first_angles(result)
    write_viewer(parts, path, result.up.direction, bounds=result.bounds, angles=angles, overwrite=overwrite)


def first_angles(result: TrimResult) -> tuple[float, float]:
    """Yaw and pitch, in radians, from which a page shows a trim at first: the middle of what was observed.

    The report's turntable begins there, too. If the whole circle was observed, or nothing, they are the usual ones.
    """
    sides = checked_sides(result.only, result.cameras)
    if not 0 < sides.degrees < 360:
        return _FIRST_ANGLES
    return float(np.radians(sides.middle)), float(np.radians(np.median(sides.pitches)))


def write_viewer(
    parts: Mapping[str, Gaussians],
    path: str | Path,
    up: Float64Array,
    *,
    bounds: Bounds | None = None,
    angles: tuple[float, float] = _FIRST_ANGLES,
    overwrite: bool = True,
) -> None:
    """Write Gaussians as a page, which appears whole or not at all.

    Args:
        parts: Gaussians by the names of what they are; of several parts the reader of the page can hide some.
        path: name of the page, which ends with .html.
        up: the up vector, (3,), around which the page turns what it shows.
        bounds: what fills the picture at first; bounds of the first part if they are not given.
        angles: yaw and pitch, in radians and in the frame of the bounds, from which it is shown at first.
        overwrite: replace the file if it exists.

    Raises:
        InputError: there are no Gaussians or more than `MOST_GAUSSIANS`, the name does not end with .html, or the file
            exists or cannot be written.
    """
    path = Path(path)
    check_page_name(path)
    if path.exists() and not overwrite:
        raise InputError(f"'{path}' exists; choose another name, or replace it with overwrite=True.")
    page = viewer_page(parts, up, path.stem, bounds, angles)
    write_whole(path, page)


def check_page_name(path: Path) -> None:
    """Refuse a page that browsers would not know as one.

    Raises:
        InputError: the name does not end with .html.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"The page '{path}' is for a browser; give it a name that ends with .html.")


def viewer_page(
    parts: Mapping[str, Gaussians],
    up: Float64Array,
    title: str,
    bounds: Bounds | None = None,
    angles: tuple[float, float] = _FIRST_ANGLES,
) -> str:
    """The page as HTML. Arguments are those of `write_viewer`, and the page's title.

    The Gaussians are in it as a .splat file, around the origin, so that single precision suffices wherever they are.
    """
    count = sum(map(len, parts.values()))
    if not count:
        raise InputError(f"There are no Gaussians to show in '{title}'.")
    if count > MOST_GAUSSIANS:
        raise InputError(
            f"A page for a browser holds at most {MOST_GAUSSIANS:,} Gaussians, which make 43 MB, and these are "
            f"{count:,}; show the object alone, or open the splat file in a viewer that is installed."
        )
    shown = [part for part in parts.values() if len(part)]
    bounds = bounds or robust_bounds(shown[0], up_frame(up))
    rows = np.concatenate([rows_of(part) for part in shown])
    rows["mean"] = np.concatenate([part.means for part in shown]).astype(np.float64) - bounds.centre
    assert rows.dtype == ROW
    data = base64.b64encode(rows.tobytes()).decode("ascii")
    ends = np.cumsum([0, *(len(part) for part in parts.values())]).tolist()
    ranges = [{"name": name, "range": ends[i : i + 2]} for i, name in enumerate(parts)]
    settings = {**first_view(bounds, angles), "axes": bounds.axes.tolist(), "centre": [0.0, 0.0, 0.0], "parts": ranges}
    groups = [("backdrop", "Backdrop", [(name, name) for name in ("light", "dark", "checker")])]
    if len(parts) > 1:
        groups.insert(0, ("part", "Show", [("", "both"), *((name, name) for name in parts)]))
    body = render(
        "viewer.html",
        title=title,
        count=count,
        help=_HELP_TEXT,
        groups=groups,
        splats=as_markup(data),
        settings=json_block("settings", settings),
    )
    return document(title, body, style=asset("viewer.css"), script=asset("viewer.js"))


def first_view(bounds: Bounds, angles: tuple[float, float] = _FIRST_ANGLES) -> dict[str, Any]:
    """From where a page shows the bounds at first: angles in radians, lengths in scene units.

    The camera is `distance` from the bounds' centre in the direction of `yaw` and `pitch` in their frame, and its
    picture's shorter side spans `fov`.
    """
    distance = bounds.radius / (_FILL_SHARE * np.sin(_FOV_RADIANS / 2))
    return {
        "yaw": angles[0],
        "pitch": angles[1],
        "distance": distance,
        "fov": _FOV_RADIANS,
        "near": _NEAR_PLANE_RADII * bounds.radius,
    }
