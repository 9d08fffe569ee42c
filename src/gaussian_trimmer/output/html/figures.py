"""The figures of the report: each view before and after, what was changed, the scene with and without the objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import SH_C0, FloatArray, Gaussians, concatenate
from gaussian_trimmer.output.pictures import (
    Picture,
    draw_gaussians,
    draw_outlines,
    nearby_background,
    nearby_rows,
    nearby_scene,
)
from gaussian_trimmer.output.report import object_entries
from gaussian_trimmer.trimming.result import RowLabel, TrimmedObject, TrimResult
from gaussian_trimmer.views.observed_angles import cameras_that_see

_Thing = TypeVar("_Thing")
_MOST_PIXELS = 512
"""Longer side of a picture."""
_MOST_VIEWS = 12
_TRAINING_CAMERAS = 2
"""Number of those from which the whole scene is shown."""
DISCARDED, FITTED = "discarded", "fitted"
_COLOURS_AND_MEANINGS = {
    "kept": ("#9a9a9a", "in the object as it was selected"),
    "removed": ("#d55e00", "was selected, and is now in the background"),
    "added": ("#00a070", "was not selected, and is now in the object"),
    "split_inside": ("#2a78d0", "a part of a Gaussian that was cut; it lies in the object"),
    "split_outside": ("#56b4e9", "a part of a Gaussian that was cut; it lies in the background"),
    "filled": ("#f0e442", "new: continues what the object stood on or leaned against"),
    "relit": ("#b8860b", "in the background, brightened to remove the object's shadow"),
    DISCARDED: ("#c45fb0", "in neither file: only the object hid it, or a new one took its place; selected or not"),
    FITTED: ("#e69f00", "adjusted to the outline (also counted above); shown in this colour if kept"),
}
_BLACK_BRIGHTNESS = 0.4
"""How bright a black Gaussian is drawn, relative to a white one of its colour."""
_LUMINANCE_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True, eq=False)
class Figure:
    """One point of view, drawn in several ways."""

    caption: str
    pictures: Mapping[str, Picture]
    """By what they show; all of one size."""
    doubt: str = ""
    """What is wrong with this view; empty if nothing is."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        height, width = next(iter(self.pictures.values())).shape[:2]
        return width, height


@dataclass(frozen=True)
class Pairing:
    """Two pictures to compare in each figure."""

    title: str
    left: str
    """What the picture on the left shows: a key of `Figure.pictures`."""
    right: str
    note: str = ""
    """What to look for."""


SELECTION, OBJECT, OUTLINES = "selection", "trimmed object", "outlines"
CHANGES, SCENE, REST = "what was done", "scene", "scene without the object"
VIEW_PAIRINGS = (
    Pairing("before and after", SELECTION, OBJECT, "The selection and the trimmed object, each alone."),
    Pairing(
        "outline found in each view",
        OBJECT,
        OUTLINES,
        "The view as it was segmented: orange is the outline of the selection, light blue that of the mask, red "
        "that of a mask that was rejected.",
    ),
)
CHANGE_PAIRINGS = (Pairing("what was done", SELECTION, CHANGES),)
BACKGROUND_PAIRINGS = (
    Pairing("scene and what is left", SCENE, REST, "The object should be gone, and everything else still there."),
)
OBJECT_PAIRINGS = (Pairing("before and after", SELECTION, OBJECT), *BACKGROUND_PAIRINGS, *CHANGE_PAIRINGS)


def shown_views(part: TrimmedObject) -> list[int]:
    """Return numbers of the views that a page shows, ascending: rejected ones before others where there are many."""
    numbers = range(len(part.views))
    rejected = [i for i in numbers if part.views[i].rejected]
    accepted = [i for i in numbers if not part.views[i].rejected]
    few = _evenly(rejected, _MOST_VIEWS if not accepted else _MOST_VIEWS // 2)
    return sorted([*few, *_evenly(accepted, _MOST_VIEWS - len(few))])


def view_figures(result: TrimResult) -> list[Figure]:
    """Draw a figure for each shown view of the only object, with the pictures of view and change pairings."""
    part, figures = result.only, []
    drawn = _before_and_after(result, part)
    for number in shown_views(part):
        view = part.views[number]
        name = f" ({view.view.camera.name})" if view.view.camera.name else ""
        figure = _draw_figure(f"view {number}{name}", view.view.camera, drawn)
        height, width = figure.pictures[OBJECT].shape[:2]
        outlines = np.asarray(cv2.resize(draw_outlines(view), (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        doubt = f"rejected: {view.rejected}" if view.rejected else ""
        figures.append(Figure(figure.caption, {**figure.pictures, OUTLINES: outlines}, doubt))
    return figures


def background_figures(result: TrimResult) -> list[Figure]:
    """Draw the scene and what is left of it, whole from training cameras if known, and about the only object."""
    part = result.only
    seeing = _evenly(cameras_that_see(result.cameras, part.bounds), _TRAINING_CAMERAS)
    whole = [(f"the whole scene from {camera.name or 'a training camera'}", camera) for camera in seeing]
    near = [(f"around the object, view {i}", part.views[i].view.camera) for i in shown_views(part)]
    layers = {SCENE: result.scene, REST: result.background} if whole else {}
    near_layers = {SCENE: nearby_scene(result, part), REST: nearby_background(result, part)} if near else {}
    return [
        *(_draw_figure(caption, camera, layers) for caption, camera in whole),
        *(_draw_figure(caption, camera, near_layers) for caption, camera in near),
    ]


def object_figures(result: TrimResult, part: TrimmedObject) -> list[Figure]:
    """Draw one of several objects from a view of it, an accepted one if there is one, with all object pairings."""
    views = [view for view in part.views if not view.rejected] or list(part.views)
    layers = {
        **_before_and_after(result, part),
        SCENE: nearby_scene(result, part),
        REST: nearby_background(result, part),
    }
    figures = [_draw_figure(part.title, view.view.camera, layers) for view in views[:1]]
    return [
        Figure(f.caption, f.pictures, f"rejected: {views[0].rejected}" if views[0].rejected else "") for f in figures
    ]


def _before_and_after(result: TrimResult, part: TrimmedObject) -> dict[str, Gaussians]:
    selected = result.scene.select(part.selected_rows)
    return {SELECTION: selected, OBJECT: part.gaussians, CHANGES: coloured_changes(result, part)}


def _draw_figure(caption: str, camera: Camera, layers: Mapping[str, Gaussians]) -> Figure:
    """Draw a figure with a picture of each of several sets of Gaussians, by what they are."""
    camera = camera.resized(min(1.0, _MOST_PIXELS / max(camera.width, camera.height)))
    return Figure(caption, {name: draw_gaussians(layer, camera) for name, layer in layers.items()})


def _evenly(things: Sequence[_Thing], count: int) -> list[_Thing]:
    """Return that many of the things, evenly spread; all of them if they are no more."""
    if len(things) <= count:
        return list(things)
    return [things[i * len(things) // count] for i in range(count)]


@dataclass(frozen=True)
class Change:
    """One line of the legend."""

    name: str
    colour: str
    """As in CSS."""
    meaning: str
    count: int
    """Number of Gaussians, or of rows where parts of one count by themselves."""


def legend_of(result: TrimResult, report: Mapping[str, Any]) -> list[Change]:
    """Return what can happen to a Gaussian, and to how many it did: the numbers of the report, or else rows."""
    counts = {label.name.lower(): result.count(label) for label in RowLabel}
    for name in ("kept", "removed", "added"):
        counts[name] = sum(entry["counts"][name] for entry in object_entries(report))
    counts |= {DISCARDED: len(result.discarded), FITTED: sum(len(part.fitted) for part in result.objects)}
    return [Change(name, *_COLOURS_AND_MEANINGS[name], number) for name, number in counts.items()]


def coloured_changes(result: TrimResult, part: TrimmedObject) -> Gaussians:
    """Return an object in grey with all that changed around it in the colours of the legend.

    The untouched background is left out: it would hide much of what happened.
    """
    scene, rows, appended = result.scene, result.background_rows, result.appended
    palette = np.array([_rgb(label.name.lower()) for label in RowLabel], np.float32)
    painted = palette[part.label]
    painted[part.fitted[part.label[part.fitted] == RowLabel.KEPT]] = _rgb(FITTED)
    removed = nearby_rows(scene, rows[result.background_label[: len(rows)] != RowLabel.KEPT], part.bounds)
    new = nearby_rows(appended, np.arange(len(appended)), part.bounds)
    discarded = nearby_rows(scene, result.discarded, part.bounds)
    return concatenate(
        [
            _painted(part.gaussians, painted),
            _painted(scene.select(removed), np.tile(palette[RowLabel.REMOVED], (len(removed), 1))),
            _painted(appended.select(new), palette[result.background_label[len(rows) + new]]),
            _painted(scene.select(discarded), np.tile(_rgb(DISCARDED), (len(discarded), 1))),
        ]
    )


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
