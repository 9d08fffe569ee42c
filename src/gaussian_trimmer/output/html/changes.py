"""What a trim did to which Gaussians, in colours: the object in grey, and all that came, went or is new around it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle

import numpy as np

from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, concatenate
from gaussian_trimmer.output.report import LABEL_NAMES
from gaussian_trimmer.result import RowLabel, TrimResult

DROPPED, FITTED = "dropped", "fitted"
_COLOURS = {
    "kept": "#9a9a9a", "pruned": "#d55e00", "recovered": "#00a070", "split_inside": "#2a78d0",
    "split_outside": "#56b4e9", "filled": "#f0e442", DROPPED: "#c45fb0", FITTED: "#e69f00",
}  # fmt: skip
_OTHER_COLOURS = ("#8a5cd6", "#a0c020", "#ff9ec4", "#00c8c8", "#b08050", "#5060ff")
"""For labels that have no colour of their own."""
_MEANINGS = {
    "kept": "in the object as it was selected",
    "pruned": "was selected, and is now in the background",
    "recovered": "was not selected, and is now in the object",
    "split_inside": "the part of a split Gaussian that lies in the object",
    "split_outside": "the part of a split Gaussian that lies in the background",
    "filled": "new: goes on with the surface that the object stood on",
    FITTED: "its numbers were fitted to the outline; counted above, too, and where it was kept in this colour",
    DROPPED: "showed only once the object was gone, and was left out of both files",
}
_DARKEST = 0.4
"""How bright a black Gaussian is drawn, relative to a white one of its colour."""
_LUMINANCE = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class Change:
    """One line of the legend."""

    name: str
    colour: str
    """As in CSS."""
    count: int
    """Number of rows of the object and of the background."""
    meaning: str


def legend_of(result: TrimResult) -> list[Change]:
    """What can happen to a Gaussian, and to how many it did; `kept` counts those of the object alone."""
    ours = result.label[: len(result.object)]
    counts = {name: result.count(number) for number, name in enumerate(LABEL_NAMES)}
    counts[LABEL_NAMES[RowLabel.KEPT]] = int(np.count_nonzero(ours == RowLabel.KEPT))
    counts |= {DROPPED: len(result.dropped), FITTED: len(result.fitted)}
    return [
        Change(name, colour, counts[name], _MEANINGS.get(name, ""))
        for name, colour in label_colours(tuple(counts)).items()
    ]


def label_colours(names: tuple[str, ...]) -> dict[str, str]:
    """A colour for each name, as in CSS: names that are not known here get what other names do not have.

    >>> label_colours(("pruned", "mended"))
    {'pruned': '#d55e00', 'mended': '#8a5cd6'}
    """
    others = cycle(_OTHER_COLOURS)
    return {name: _COLOURS.get(name) or next(others) for name in names}


def coloured_changes(result: TrimResult) -> Gaussians:
    """The object in grey with all that changed around it in the colours of the legend.

    The untouched background is left out: it would hide much of what happened.
    """
    n, rows = len(result.object), result.background_rows
    ours, theirs = result.label[:n], result.label[n:]
    moved = np.flatnonzero(theirs[: len(rows)] != RowLabel.KEPT)
    colours = label_colours((*LABEL_NAMES, DROPPED, FITTED))
    palette = np.array([_rgb(colours[name]) for name in LABEL_NAMES], np.float32)
    painted = palette[ours]
    painted[result.fitted[ours[result.fitted] == RowLabel.KEPT]] = _rgb(colours[FITTED])
    parts = [
        _painted(result.object, painted),
        _painted(result.scene.select(rows[moved]), palette[theirs[moved]]),
        _painted(result.appended, palette[theirs[len(rows) :]]),
        _painted(result.scene.select(result.dropped), np.tile(_rgb(colours[DROPPED]), (len(result.dropped), 1))),
    ]
    return concatenate(parts)


def _painted(gaussians: Gaussians, colours: FloatArray) -> Gaussians:
    """Gaussians in other colours (N, 3), from any side the same, as bright as they were but none of them black."""
    light = np.clip((0.5 + SH_C0 * gaussians.sh_dc) @ _LUMINANCE, 0, 1)
    rgb = colours * (_DARKEST + (1 - _DARKEST) * light)[:, None]
    return Gaussians(
        gaussians.means, gaussians.log_scales, gaussians.quaternions, gaussians.opacity_logits,
        ((rgb - 0.5) / SH_C0).astype(np.float32), np.zeros((len(gaussians), 3, 0), np.float32),
    )  # fmt: skip


def _rgb(colour: str) -> FloatArray:
    """Red, green and blue from 0 to 1 of "#rrggbb", (3,)."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.float32) / np.float32(255)
