"""What a browser draws: a scene packed once, and four bytes a Gaussian that say what of it is seen, in which tint.

The browser has Gaussians in an order of its own, near ones beside each other, so that what changes together compresses
well. Of sixteen neighbours it gets the one that covers most first, so that it has a coarse scene at once. N Gaussians
of the scene.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.app.snapshots import MarkedObject, Snapshot
from gaussian_trimmer.app.viewpoints import Frame, Showing
from gaussian_trimmer.gaussians import SH_C0, BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.trimming.result import RowLabel, TrimResult

ADDED, REMOVED, CUT, MADE_UP, GONE, REPLACED, ACTIVE_REMOVED, EXTRA = (1 << bit for bit in range(8))
"""Bits of what a Gaussian is, as `canvas.js` reads them: changes, which are tinted; not in the scene any more once
objects are cut out; with others in its place; removed from the active object; and of a trim, not of the scene."""
_CHANGES = ADDED | REMOVED | CUT | MADE_UP
PIECE, FILL = GONE, REPLACED
"""Bits of Gaussians of a trim: of the object, or of the scene without it; with neither they are not seen."""
_PORTIONS = 16
_LOG_SCALES = (-14.0, 6.0)
_ROUGH_CELLS = 1024
"""Cells along an axis by which Gaussians are ordered."""
_STRAYS = 0.01
"""Share of Gaussians at either end that count for neither the cells nor how much the largest covers."""
_TONES = (-0.25, 1.25)
"""Colours of the bytes 0 and 255 where harmonics are added."""
_LARGEST_HARMONIC = 0.998
"""Quantile of the harmonics' sizes that a byte can hold."""
_OBJECTS = 255
"""Objects that have a tint of their own; later ones have the last one's."""

States = NDArray[np.uint8]
"""The object before, the object after, and the bits of Gaussians, (N, 3); objects count from 1, and 0 is none."""


@dataclass(frozen=True, eq=False)
class Packing:
    """How a scene is packed."""

    frame: Frame
    order: IntArray
    """Rows of the scene, near ones beside each other, those of each sixteen that cover most first, (N,)."""
    covered: tuple[float, ...]
    """Share of what all Gaussians cover that is covered after each portion."""
    tones: tuple[float, float]
    harmonics: float
    """The largest harmonic of degree 1 that can be said; 0 for none."""

    @classmethod
    def of(cls, scene: Gaussians) -> Packing:
        """Return how to pack a scene."""
        frame, largest = Frame.around(scene.means), 0.0
        points = frame.to_viewer(scene.means)
        low, high = np.quantile(points, (_STRAYS, 1 - _STRAYS), axis=0)
        cells = np.clip((points - low) / np.maximum(high - low, 1e-9), 0, 1) * (_ROUGH_CELLS - 1)
        codes = sum((_spread(cells[:, axis].astype(np.int64)) << axis for axis in range(3)), np.zeros(len(cells), int))
        if scene.sh_degree > 0 and len(scene):
            largest = float(np.quantile(np.abs(scene.sh_rest[:, :, :3]), _LARGEST_HARMONIC))
        cover = scene.opacities * np.exp(scene.log_scales.sum(axis=1) - scene.log_scales.min(axis=1))
        cover = np.minimum(cover, np.quantile(cover, 1 - _STRAYS))
        order = np.argsort(codes, kind="stable")
        order = order[np.lexsort((-cover[order], np.arange(len(order)) // _PORTIONS))]
        shares = np.cumsum([cover[order[first::_PORTIONS]].sum() for first in range(_PORTIONS)], dtype=np.float64)
        covered = tuple((shares / max(shares[-1], 1e-30)).tolist())
        return cls(frame, order, covered, _TONES if largest else (0.0, 1.0), largest)

    def _firsts(self, most: int) -> Iterator[IntArray]:
        """Yield the rows of each portion of about so many Gaussians, the coarse one first."""
        for first in range(_PORTIONS):
            if not first or (first + 1) * len(self.order) <= _PORTIONS * most:
                yield self.order[first::_PORTIONS]

    def shown(self, most: int) -> int:
        """Return how many Gaussians are drawn if there should be no more than about so many."""
        return sum(map(len, self._firsts(most)))

    def portions(self, scene: Gaussians, most: int) -> Iterator[bytes]:
        """Yield a scene, the coarse one first, 32 bytes a Gaussian; no more than about `most`."""
        for rows in self._firsts(most):
            yield self.pack(scene.select(rows))

    def pack(self, gaussians: Gaussians) -> bytes:
        """Return Gaussians as `canvas.js` draws them: place, scales, colours, rotation and harmonics of degree 1."""
        words = np.zeros((len(gaussians), 8), np.uint32)
        words[:, :3] = self.frame.to_viewer(gaussians.means).astype(np.float32).view(np.uint32)
        low, high = _LOG_SCALES
        scales = gaussians.log_scales + np.float32(np.log(self.frame.scale))
        words[:, 3] = _packed((scales - low) / (high - low) * 1023, 10)
        colours = (0.5 + SH_C0 * gaussians.sh_dc - self.tones[0]) / (self.tones[1] - self.tones[0])
        words[:, 4] = _packed(np.column_stack([colours, gaussians.opacities]) * 255, 8)
        turns = gaussians.quaternions / np.maximum(np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True), 1e-12)
        largest = np.argmax(np.abs(turns), axis=1)
        turns *= np.where(np.take_along_axis(turns, largest[:, None], 1) < 0, -1, 1)
        small = turns[np.arange(4) != largest[:, None]].reshape(-1, 3)
        words[:, 5] = _packed((small * np.sqrt(2) + 1) * 511, 10) | (largest.astype(np.uint32) << 30)
        if self.harmonics:
            rest = np.zeros((len(gaussians), 3, 3), np.float32)
            rest[:, :, : gaussians.sh_rest.shape[2]] = gaussians.sh_rest[:, :, :3]
            steps = np.clip((rest.reshape(-1, 9) / self.harmonics + 1) * 63 + 0.5, 0, 126).astype(np.uint32)
            for word, parts in ((6, steps[:, :4]), (7, steps[:, 4:8])):
                words[:, word] = parts @ (1 << 7 * np.arange(4)).astype(np.uint32)
            words[:, 6] |= (steps[:, 8] & 15) << 28
            words[:, 7] |= (steps[:, 8] >> 4) << 28
        return words.tobytes()


def _spread(values: IntArray) -> IntArray:
    """Return numbers of 10 bits with two zeros between their bits."""
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        values = (values | (values << shift)) & mask
    return values


def _packed(values: FloatArray, bits: int) -> NDArray[np.uint32]:
    """Return rows of numbers as words, the first in the lowest bits."""
    whole = np.clip(values + 0.5, 0, (1 << bits) - 1).astype(np.uint32)
    shifts = (bits * np.arange(values.shape[1])).astype(np.uint32)
    return np.asarray(np.bitwise_or.reduce(whole << shifts, axis=1), np.uint32)


@dataclass(frozen=True, eq=False)
class Layer:
    """Gaussians of a trim that the scene does not have: pieces of the object, and of the scene without it."""

    number: int
    """No other result has it."""
    gaussians: Gaussians
    states: States


class Painter:
    """Says what browsers see of the states of one scene."""

    def __init__(self, scene: Gaussians) -> None:
        self.scene, self.packing = scene, Packing.of(scene)
        self._numbers = WeakKeyDictionary[TrimResult, int]()
        self._count = count(1)

    def states(self, now: Snapshot) -> States:
        """Return what each Gaussian of the scene is, in the scene's order."""
        told = np.zeros((len(self.scene), 3), np.uint8)
        for plane, after in enumerate((False, True)):
            told[:, plane] = np.minimum(_owners(now, after) + 1, _OBJECTS)
        bits = told[:, 2]
        for part in now.objects:
            for bit, rows in zip((ADDED, REMOVED, CUT, MADE_UP), changed_rows(part), strict=True):
                bits[rows] |= bit
            if part.result is not None:
                bits[part.result.discarded] |= GONE
                bits[_relit_rows(part.result)] |= GONE
                bits[part.result.objects[0].source_index[_new_rows(part)]] |= REPLACED
        bits[_removed_rows(now)] |= ACTIVE_REMOVED
        return told

    def layers(self, now: Snapshot, told: States) -> list[Layer]:
        """Return what there is beside the scene, given what its own Gaussians are.

        What was filled in for objects that were cut out together is there once.
        """
        layers, filled = [], list[Gaussians]()
        for part in now.objects:
            if (result := part.result) is not None:
                first = not any(result.rest.appended is each for each in filled)
                layers.append(self._layer(part, result, told, FILL if first else 0))
                filled.append(result.rest.appended)
        return layers

    def _layer(self, part: MarkedObject, result: TrimResult, told: States, fill: int) -> Layer:
        trimmed, first = result.objects[0], len(result.rest.rows)
        rows = _pieces(result)
        pieces = told[trimmed.source_index[rows]]
        pieces[:, 2] = (pieces[:, 2] & _CHANGES) | EXTRA
        pieces[np.isin(rows, _new_rows(part)), 2] |= PIECE
        labels, sources = result.background_label[first:], result.background_source[first:]
        fills = np.zeros((len(labels), 3), np.uint8)
        fills[:, 2] = EXTRA | fill
        relit = labels == RowLabel.RELIT
        fills[relit, 2] |= told[sources[relit], 2] & _CHANGES
        fills[labels == RowLabel.FILLED, 2] |= MADE_UP
        number = self._numbers.setdefault(result, next(self._count))
        both = concatenate([trimmed.gaussians.select(rows), result.rest.appended])
        return Layer(number, both, np.concatenate([pieces, fills]))


def changes_as_bytes(before: States | None, after: States, layers: Sequence[Layer], order: IntArray) -> bytes:
    """Return what is told of a state: which Gaussians are not as before, what they are, and the layers whole.

    That is a line of JSON with the numbers of bytes, then three compressed parts; the first has a bit a Gaussian, the
    second all first bytes of those that changed, then all second ones, and so on.
    """
    after = after[order]
    changed = after.any(axis=1) if before is None else (after != before[order]).any(axis=1)
    extras = np.concatenate([np.zeros((0, 3), np.uint8), *(layer.states for layer in layers)])
    parts = [np.packbits(changed, bitorder="little"), after[changed].T, extras.T]
    packed = [zlib.compress(np.ascontiguousarray(part).tobytes(), 6) for part in parts]
    told = {"whole": before is None, "layers": [[layer.number, len(layer.gaussians)] for layer in layers]}
    head = json.dumps(told | {"bytes": [len(part) for part in packed]})
    return b"\n".join([head.encode(), b"".join(packed)])


def shown_rows(now: Snapshot, showing: Showing) -> BoolArray:
    """Return which Gaussians of the scene are to be seen, whole or as what a trim has in their place, (N,)."""
    after = showing.when == "Cut-out"
    owner = _owners(now, after)
    if showing.part == "Object" and not showing.ghost:
        removed = _removed_rows(now) if showing.colours == "Changes" else False
        return np.asarray((owner == now.active) | removed)
    unseen = np.zeros(len(owner), np.bool_)
    for place, part in enumerate(now.objects):
        if part.hidden or (showing.part == "Scene without it" and _is_taken_out(now, part)):
            unseen |= owner == place
        if after and (result := part.result) is not None:
            unseen[result.discarded] = True
            unseen[_relit_rows(result)] = True
    return ~unseen


def _is_taken_out(now: Snapshot, part: MarkedObject) -> bool:
    """Tell whether the scene without the active object is without another one, too."""
    return part is now.object or (part.together and now.object.together)


def markable_rows(now: Snapshot, showing: Showing) -> BoolArray:
    """Return which Gaussians a mark can change, (N,).

    Those that are shown and, with the object alone, those that are selected and that its trim has removed.
    """
    shown = shown_rows(now, showing)
    return shown | now.object.selected.mask if showing.part == "Object" else shown


def changed_rows(part: MarkedObject) -> tuple[BoolArray, BoolArray, BoolArray, BoolArray]:
    """Return rows of the scene that were added, removed, cut to the outline, and freed from the shadow, (N,) each.

    By the marks since the last cut-out or, if there are none, by the trim.
    """
    result, had, has = part.fresh, part.before, part.mask
    cut, relit = np.zeros(len(has), np.bool_), np.zeros(len(has), np.bool_)
    if had is None:
        had = has if result is None else result.selection
        if result is not None:
            cut[result.objects[0].source_index[_new_rows(part)]] = True
            relit[_relit_rows(result)] = True
    return has & ~had, had & ~has, cut, relit


def _removed_rows(now: Snapshot) -> BoolArray | bool:
    """Return what was removed from the active object and is seen beside it, (N,); what a mark removed is gone."""
    corrected = now.object.fresh is not None and now.object.before is not None
    return False if corrected else changed_rows(now.object)[1]


def _owners(now: Snapshot, after: bool) -> NDArray[np.int16]:
    """Return the place of the object that has each Gaussian of the scene, (N,); -1 for none; the active one first."""
    owner = np.full(len(now.object.selected.mask), -1, np.int16)
    order = [place for place in range(len(now.objects)) if place != now.active] + [now.active]
    for place in order:
        part = now.objects[place]
        owner[part.mask if after else part.selected.mask] = place
    return owner


def _new_rows(part: MarkedObject) -> IntArray:
    """Return rows of an object's trim that the scene does not have: parts of split Gaussians, and fitted ones."""
    result = part.result
    assert result is not None
    trimmed, rows = result.objects[0], _pieces(result)
    return rows if part.fresh is not None else rows[part.mask[trimmed.source_index[rows]]]


def _relit_rows(result: TrimResult) -> IntArray:
    """Return rows of the scene that a trim freed from the object's shadow."""
    return np.asarray(result.background_source[result.background_label == RowLabel.RELIT])


def _pieces(result: TrimResult) -> IntArray:
    """Return rows of a trim's object that the scene does not have."""
    trimmed = result.objects[0]
    return np.union1d(np.flatnonzero(trimmed.label == RowLabel.SPLIT_INSIDE), trimmed.fitted)
