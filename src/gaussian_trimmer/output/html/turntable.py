"""The object turning: pictures of it from all around, and a dial of the sides that were checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.output.checked_sides import CheckedSides, angles_around
from gaussian_trimmer.output.html.document import text
from gaussian_trimmer.output.html.layers import CHANGES, OBJECT, SELECTION
from gaussian_trimmer.output.html.pictures import above_its_alpha
from gaussian_trimmer.output.pictures import cameras_around
from gaussian_trimmer.result import TrimResult

FRAMES = 30
"""Angles from which the object is drawn."""
_SIDE = 384
"""Width and height of a frame in pixels."""
_OUTER, _INNER, _LABEL = 88, 62, 46
"""Radii of the dial's ring and of its numbers, in a picture of 200."""
_BACKDROPS = ("light", "dark", "checker")


@dataclass(frozen=True, eq=False)
class Ring:
    """Pictures from all around."""

    frames: dict[str, list[NDArray[np.uint8]]]
    """By what they show: a picture for each yaw, (2 S, S, 3), as `above_its_alpha` makes it."""
    yaws: list[int]
    """Degrees of yaw of the frames."""
    verdicts: list[str]
    """Why a side was not checked; empty if it was."""


def draw_ring(result: TrimResult, sides: CheckedSides, changes: Gaussians) -> Ring:
    """The rough selection, the object and what was done, from all around, without anything behind."""
    yaws, cameras = cameras_around(result, result.selection, sides, FRAMES, _SIDE)
    parts = {OBJECT: result.object, SELECTION: result.scene.select(result.selection), CHANGES: changes}
    frames: dict[str, list[NDArray[np.uint8]]] = {}
    for name, part in parts.items():
        if len(part):
            drawn = [result.used_renderer.render(part, camera) for camera in cameras]
            frames[name] = [above_its_alpha(picture.rgb, picture.alpha) for picture in drawn]
    return Ring(frames, yaws, [sides.verdict(yaw) for yaw in yaws])


def turntable(ring: Ring, frames: dict[str, list[str]]) -> tuple[str, dict[str, object]]:
    """The element, and the data that the page's script turns it by.

    Args:
        ring: the pictures.
        frames: their addresses.
    """
    shown = _choice("shown", "Show", [*frames], next(iter(frames)))
    backdrops = _choice("backdrop", "Backdrop", _BACKDROPS, _BACKDROPS[0])
    body = (
        f'<div id="turntable" class="light"><canvas id="frame" width="{_SIDE}" height="{_SIDE}" role="img" '
        'aria-label="the object from all around; the angle is set below"></canvas></div>'
        "<noscript><p>The object turns only where scripts are allowed.</p></noscript>"
        f'<div class="controls"><button type="button" id="play" aria-pressed="false">turn</button>'
        f'<label for="angle">angle</label><input type="range" id="angle" min="0" max="{len(ring.yaws) - 1}" value="0">'
        f'<output id="side" for="angle"></output></div>{shown}{backdrops}'
    )
    return body, {"frames": frames, "yaws": ring.yaws, "verdicts": ring.verdicts}


def dial(result: TrimResult, sides: CheckedSides) -> str:
    """A circle seen from above: the sides that were checked and those that were not, and where the views stood."""
    yaws, _ = angles_around(result.bounds, [view.view.camera for view in result.views])
    kinds = [
        ("checked", sides.checked), ("rejected", sides.rejected & ~sides.checked),
        ("unseen", ~sides.checked & ~sides.rejected),
    ]  # fmt: skip
    arcs = "".join(
        f'<path class="{kind}" d="{_arc(first, last)}"></path>' for kind, flags in kinds for first, last in _runs(flags)
    )
    places = "".join(
        f'<text class="{"bad" if view.rejected else ""}" x="{x:.1f}" y="{y:.1f}">{number}</text>'
        for number, (yaw, view) in enumerate(zip(yaws, result.views, strict=True))
        for x, y in [_on_circle(float(yaw), _LABEL)]
    )
    legend = "".join(
        f'<li><span class="swatch {kind}"></span>{words}: {int(np.count_nonzero(flags))} degrees</li>'
        for (kind, flags), words in zip(
            kinds, ("checked", "only a rejected view shows it", "no view, or no photograph, from here"), strict=True
        )
    )
    return (
        f'<div class="dial"><svg viewBox="0 0 200 200" role="img" aria-label="{text(sides.sentence())}">{arcs}{places}'
        f'<line id="needle" x1="100" y1="100" x2="100" y2="30"></line></svg><ul class="legend">{legend}</ul></div>'
    )


def _choice(name: str, legend: str, values: Sequence[str], chosen: str) -> str:
    buttons = "".join(
        f'<label><input type="radio" name="{name}" value="{text(value)}"{" checked" if value == chosen else ""}>'
        f" {text(value)}</label>"
        for value in values
    )
    return f'<fieldset class="choice"><legend>{legend}</legend>{buttons}</fieldset>'


def _runs(flags: BoolArray) -> list[tuple[int, int]]:
    """First and one past the last degree of each run of True; none passes 360."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _arc(first: float, last: float) -> str:
    """The path of a piece of the dial's ring; a full circle is drawn a little short, since its ends would coincide."""
    last = min(last, first + 359.9)
    large = int(last - first > 180)
    points = [_on_circle(angle, radius) for radius in (_OUTER, _INNER) for angle in (first, last)]
    (x0, y0), (x1, y1), (x3, y3), (x2, y2) = points
    return (
        f"M{x0:.2f} {y0:.2f}A{_OUTER} {_OUTER} 0 {large} 0 {x1:.2f} {y1:.2f}"
        f"L{x2:.2f} {y2:.2f}A{_INNER} {_INNER} 0 {large} 1 {x3:.2f} {y3:.2f}Z"
    )


def _on_circle(degrees: float, radius: float) -> tuple[float, float]:
    """A point of the dial: yaw 0 is on the right, and yaw grows against the clock, as seen from above."""
    angle = np.radians(degrees)
    return 100 + radius * float(np.cos(angle)), 100 - radius * float(np.sin(angle))
