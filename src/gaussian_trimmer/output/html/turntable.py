"""The object turning: pictures of it from all around, and a dial of the sides that were checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.output.checked_sides import CheckedSides, angles_around
from gaussian_trimmer.output.html.comparison import Figure
from gaussian_trimmer.output.html.document import json_block, text
from gaussian_trimmer.output.html.layers import CHANGES, OBJECT, SELECTION
from gaussian_trimmer.output.html.pictures import above_its_alpha, data_uris
from gaussian_trimmer.output.pictures import cameras_around
from gaussian_trimmer.rendering import Renderer
from gaussian_trimmer.result import TrimResult

FRAMES = 30
"""Angles from which the object is drawn."""
SIDE = 384
"""Width and height of a frame in pixels."""
_OUTER, _INNER, _LABEL = 88, 62, 50
"""Radii of the dial's ring and of its numbers, in a picture of 200."""
_ROW, _ROWS = 13, 3
"""Distance of the rows of numbers, and how many there are."""
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


def draw_ring(
    parts: Mapping[str, Gaussians], yaws: list[int], cameras: Sequence[Camera], verdicts: list[str], renderer: Renderer
) -> Ring:
    """Gaussians from all around, without anything behind; parts without any are left out."""
    frames: dict[str, list[NDArray[np.uint8]]] = {}
    for name, part in parts.items():
        if len(part):
            drawn = [renderer.render(part, camera) for camera in cameras]
            frames[name] = [above_its_alpha(picture.rgb, picture.alpha) for picture in drawn]
    return Ring(frames, yaws, verdicts)


def ring_of_trim(result: TrimResult, sides: CheckedSides, changes: Gaussians) -> Ring:
    """The object, the rough selection and what was done, from all around."""
    yaws, cameras = cameras_around(result, result.selection, sides, FRAMES, SIDE)
    parts = {OBJECT: result.object, SELECTION: result.scene.select(result.selection), CHANGES: changes}
    return draw_ring(parts, yaws, cameras, [sides.verdict(yaw) for yaw in yaws], result.used_renderer)


def addresses(figures: Sequence[Figure], rings: Sequence[Ring], limit: int) -> dict[int, str]:
    """Address of each picture of a page by its `id`; all together have at most `limit` characters."""
    drawn = [picture for figure in figures for picture in figure.pictures.values()]
    drawn += [frame for ring in rings for frames in ring.frames.values() for frame in frames]
    return {id(picture): uri for picture, uri in zip(drawn, data_uris(drawn, limit), strict=True)}


def turntable(name: str, ring: Ring, uris: Mapping[int, str]) -> str:
    """The element that turns; the page's script looks for it within an element of the class `turning`.

    Args:
        name: distinguishes the element from others of the page.
        ring: the pictures.
        uris: address of each picture by its `id`.
    """
    frames = {shown: [uris[id(frame)] for frame in drawn] for shown, drawn in ring.frames.items()}
    side = next(iter(ring.frames.values()))[0].shape[1]
    data = json_block(f"{name}-data", {"frames": frames, "yaws": ring.yaws, "verdicts": ring.verdicts})
    return (
        f'<div class="turntable light"><canvas width="{side}" height="{side}" role="img" '
        'aria-label="the object from all around; the angle is set below"></canvas></div>'
        "<noscript><p>The object turns only where scripts are allowed.</p></noscript>"
        '<div class="controls"><button type="button" class="play" aria-pressed="false">turn</button>'
        f'<label for="{name}-angle">angle</label><input type="range" class="angle" id="{name}-angle" min="0" '
        f'max="{len(ring.yaws) - 1}" value="0"><output for="{name}-angle"></output></div>'
        f"{_choice(f'{name}-shown', 'Show', [*frames], 'shown')}"
        f"{_choice(f'{name}-backdrop', 'Backdrop', _BACKDROPS, 'backdrop')}{data}"
    )


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
        for x, y in [_on_circle(float(yaw), _LABEL - _ROW * (number % _ROWS))]  # neighbours would overlap
    )
    legend = "".join(
        f'<li><span class="swatch {kind}"></span>{words}: {int(np.count_nonzero(flags))} degrees</li>'
        for (kind, flags), words in zip(
            kinds, ("checked", "only a rejected view shows it", "no view, or no photograph, from here"), strict=True
        )
    )
    return (
        f'<div class="dial"><svg viewBox="0 0 200 200" role="img" aria-label="{text(sides.sentence())}">{arcs}{places}'
        f'<line class="needle" x1="100" y1="100" x2="100" y2="30"></line></svg><ul class="legend">{legend}</ul></div>'
    )


def _choice(name: str, legend: str, values: Sequence[str], kind: str) -> str:
    """Buttons of which the first is chosen."""
    buttons = "".join(
        f'<label><input type="radio" class="{kind}" name="{name}" value="{text(value)}"{"" if i else " checked"}>'
        f" {text(value)}</label>"
        for i, value in enumerate(values)
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
