"""What a trim did to which Gaussians, in colours: the object in grey, and all that came, went or is new around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, concatenate
from gaussian_trimmer.output.report import LABEL_NAMES
from gaussian_trimmer.result import RowLabel, TrimResult

LEFT_OUT, FITTED = "left_out", "fitted"
_COLOURS_AND_MEANINGS = {
    "kept": ("#9a9a9a", "in the object as it was selected"),
    "removed": ("#d55e00", "was selected, and is now in the background"),
    "recovered": ("#00a070", "was not selected, and is now in the object"),
    "split_inside": ("#2a78d0", "a part of a Gaussian that was cut; it lies in the object"),
    "split_outside": ("#56b4e9", "a part of a Gaussian that was cut; it lies in the background"),
    "filled": ("#f0e442", "new: continues what the object stood on or leaned against"),
    "relit": ("#b8860b", "in the background, brighter: the object's shadow is gone"),
    LEFT_OUT: ("#c45fb0", "only the object hid it, or a new one took its place; in neither file"),
    FITTED: ("#e69f00", "adjusted to the outline (also counted above); shown in this colour if kept"),
}
_BLACK_BRIGHTNESS = 0.4
"""How bright a black Gaussian is drawn, relative to a white one of its colour."""
_LUMINANCE_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class Change:
    """One line of the legend."""

    name: str
    colour: str
    """As in CSS."""
    meaning: str
    count: int
    """Number of rows of the object and of the background."""


def legend_of(result: TrimResult) -> list[Change]:
    """What can happen to a Gaussian, and to how many rows it did; `kept` counts those of the object alone."""
    counts = {name: result.count(number) for number, name in enumerate(LABEL_NAMES)}
    counts["kept"] = int(np.count_nonzero(result.label[: len(result.object)] == RowLabel.KEPT))
    counts |= {LEFT_OUT: len(result.dropped), FITTED: len(result.fitted)}
    return [Change(name, *_COLOURS_AND_MEANINGS[name], number) for name, number in counts.items()]


def coloured_changes(result: TrimResult) -> Gaussians:
    """The object in grey with all that changed around it in the colours of the legend.

    The untouched background is left out: it would hide much of what happened.
    """
    n, rows = len(result.object), result.background_rows
    ours, theirs = result.label[:n], result.label[n:]
    moved = np.flatnonzero(theirs[: len(rows)] != RowLabel.KEPT)
    palette = np.array([_rgb(name) for name in LABEL_NAMES], np.float32)
    painted = palette[ours]
    painted[result.fitted[ours[result.fitted] == RowLabel.KEPT]] = _rgb(FITTED)
    parts = [
        _painted(result.object, painted),
        _painted(result.scene.select(rows[moved]), palette[theirs[moved]]),
        _painted(result.appended, palette[theirs[len(rows) :]]),
        _painted(result.scene.select(result.dropped), np.tile(_rgb(LEFT_OUT), (len(result.dropped), 1))),
    ]
    return concatenate(parts)


def _painted(gaussians: Gaussians, colours: FloatArray) -> Gaussians:
    """Gaussians in other colours (N, 3), from any side the same, as bright as they were but none of them black."""
    light = np.clip((0.5 + SH_C0 * gaussians.sh_dc) @ _LUMINANCE_WEIGHTS, 0, 1)
    rgb = colours * (_BLACK_BRIGHTNESS + (1 - _BLACK_BRIGHTNESS) * light)[:, None]
    sh_dc, no_rest = ((rgb - 0.5) / SH_C0).astype(np.float32), np.zeros((len(gaussians), 3, 0), np.float32)
    return gaussians.replace(sh_dc=sh_dc, sh_rest=no_rest, extras={})


def _rgb(name: str) -> FloatArray:
    """Red, green and blue from 0 to 1 of what happened to a Gaussian, (3,)."""
    colour = _COLOURS_AND_MEANINGS[name][0]
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.float32) / np.float32(255)
