"""Pictures of a trim: the views with their outlines, and the object before and after.

Pictures are 8-bit BGR arrays (H, W, 3), as OpenCV writes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.io.writing import write_whole
from gaussian_trimmer.output.report import checked_sentence, checked_sides, judged_pitches, middle_degree, why_unchecked
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.rendering import render
from gaussian_trimmer.trimming.config import CONTEXT_RADIUS
from gaussian_trimmer.trimming.result import TrimmedObject, TrimResult
from gaussian_trimmer.views.view import HALF, TrimmedView
from gaussian_trimmer.views.virtual_cameras import PlanConfig, plan_cameras

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

BACKDROP = np.full(3, 0.5, np.float32)
"""Neutral grey behind all pictures: neither dark nor light edges of a cut-out vanish in it."""
_WHOLE_OBJECT_MARGIN = 1.05
"""Distance of the frame from the outermost Gaussians of the object, relative to theirs from the middle."""
_SMALLEST_ZOOM = 0.25
"""How much a picture may be widened for single Gaussians far from the rest."""
_SCENE_ZOOM = 0.65
"""How much smaller the scene without the object is drawn than the object."""
_HIDING_ALPHA = 0.3
"""Mean opacity before an object's place from which on what stands there is left out."""
_MOST_DRAWN = 2_000_000
"""Gaussians of a scene that its row holds."""
_SELECTION_COLOUR: Colour = (40, 150, 255)
_MASK_COLOUR: Colour = (255, 235, 60)
_REJECTED_COLOUR: Colour = (70, 70, 255)
_STRIP_COLOUR: Colour = (32, 32, 32)
_TEXT_COLOUR: Colour = (235, 235, 235)
_LINE_HEIGHT = 26
_FONT_SCALE = 0.5
_RING_COLUMNS = 4
_LOW_PITCH_DEGREES, _HIGH_PITCH_DEGREES = 4.0, 65.0
"""Pitches of the two pictures beside those of the ring that was judged."""
_CELL_PIXELS, _SMALL_CELL_PIXELS = 320, 200
"""Sides of a picture where there is one object, and where there are several."""
_OBJECTS_A_ROW, _MOST_OBJECTS = 4, 60
_GAP_PIXELS = 4
_GRID_STEPS, _GRID_LINES = (20, 25, 50, 100, 200, 250, 500, 1000), 12
"""Distances of the lines of a grid in pixels, and their number along the longer side, about."""
_GRID_COLOUR: Colour = (255, 255, 255)
_AXIS_PIXELS = 40
"""Length of an axis of the scene that lies in the picture's plane."""
_NUMBER_SCALE = 0.4
_USUAL_PITCH_DEGREES = 20.0
"""Of pictures of an object that no view has judged."""
_MAX_PITCH_DEGREES = 80.0


def draw_view(view: TrimmedView, number: int) -> Picture:
    """A virtual view as it was segmented, with the outlines of the selection and of the mask, and a legend."""
    picture = draw_outlines(view)
    if view.rejected:
        _frame(picture)
    mask_colour = _REJECTED_COLOUR if view.rejected else _MASK_COLOUR
    legend = [(f"view {number}", _TEXT_COLOUR), ("selection", _SELECTION_COLOUR), ("mask", mask_colour)]
    hidden = round(100 * view.view.hidden_share)
    approval = "accepted" if view.judged else "not judged"
    approval += f"; {hidden} % of the object is behind something nearer" if hidden else ""
    verdict = [(f"rejected: {view.rejected}", _REJECTED_COLOUR)] if view.rejected else [(approval, _TEXT_COLOUR)]
    return np.vstack([picture, _strip(legend, picture.shape[1]), _strip(verdict, picture.shape[1])])


def draw_outlines(view: TrimmedView) -> Picture:
    """A virtual view as it was segmented, with the outlines of the selection and of the mask below it."""
    picture = as_picture(view.view.rgb + (1 - view.view.alpha)[..., None] * BACKDROP)
    # The thick line below still shows where both outlines agree.
    _draw_outline(picture, view.view.object_visible > HALF, _SELECTION_COLOUR, 2)
    _draw_outline(picture, view.mask, _REJECTED_COLOUR if view.rejected else _MASK_COLOUR, 1)
    return picture


def draw_gaussians(gaussians: Gaussians, camera: Camera) -> Picture:
    """Gaussians before the neutral backdrop, which is all that there is to see of none."""
    if not len(gaussians):
        return as_picture(np.tile(BACKDROP, (camera.height, camera.width, 1)))
    return as_picture(render(gaussians, camera, BACKDROP).rgb)


def draw_before_after(result: TrimResult) -> Picture:
    """Draw the selection, the trimmed object and the scene without it, a row each, from all around.

    There is no row for a scene of which nothing is left, or from which nothing was trimmed.
    Directions from which nothing was judged are framed and say why. The scene's row holds all of it, but not what would
    stand between a camera and the object's surroundings, such as walls. One object is also shown from low and from
    high. Of several, each has a smaller block, from two sides.
    """
    if len(result.objects) == 1:
        return _draw_object(
            result, result.objects[0], _RING_COLUMNS, (_LOW_PITCH_DEGREES, _HIGH_PITCH_DEGREES), _CELL_PIXELS
        )
    blocks = [_draw_object(result, part, 2, (), _SMALL_CELL_PIXELS) for part in result.objects[:_MOST_OBJECTS]]
    blocks = [captioned(part.title, block) for part, block in zip(result.objects, blocks, strict=False)]
    columns = min(len(blocks), _OBJECTS_A_ROW)
    blocks += [np.full_like(blocks[0], _STRIP_COLOUR)] * (-len(blocks) % columns)
    return np.vstack([side_by_side(blocks[i : i + columns]) for i in range(0, len(blocks), columns)])


def _draw_object(result: TrimResult, part: TrimmedObject, columns: int, pitches: Sequence[float], size: int) -> Picture:
    """Draw one object from a number of sides, and from other pitches in degrees."""
    sides, selected = checked_sides(part, result.cameras), result.scene.select(part.selected_rows)
    yaws, cameras = cameras_around(part, selected, middle_degree(sides[0]), columns, size, pitches)
    verdicts = [why_unchecked(yaw, *sides) for yaw in (*yaws, *(yaws[:1] * len(pitches)))]
    after = "the object, not trimmed" if part.refused else "trimmed object"
    scene = _background_around(result, part)
    rest = "what was removed" if len(selected) == len(result.scene) else "the scene without the object"
    rows = [
        (f"selection: {len(selected):,} Gaussians", selected, cameras),
        (f"{after}: {len(part.gaussians):,} Gaussians", part.gaussians, cameras),
    ]
    if len(scene) and not result.nothing_trimmed:
        wider = [zoomed(camera, _SCENE_ZOOM) for camera in cameras]  # the object's place, and what it stood on
        rows.append((rest, scene, [_past_what_hides(camera, scene, part.bounds) for camera in wider]))
    pictures = [_row(*row, verdicts) for row in rows]
    width = pictures[0].shape[1]
    closing = f"not trimmed: {part.refused}" if part.refused else checked_sentence(part, sides[0])
    strip = _strip([(closing, _REJECTED_COLOUR if part.refused else _TEXT_COLOUR)], width)
    return np.vstack([_headings(yaws, pitches, verdicts, width), *pictures, strip])


def cameras_around(
    part: TrimmedObject, selected: Gaussians, first: int, count: int, size: int, pitches: Sequence[float] = ()
) -> tuple[list[int], list[Camera]]:
    """Return whole degrees of yaw, beginning with the first, and cameras of the whole object.

    After the cameras of these yaws, at the height that was judged, come those of the first yaw and of other pitches.

    Args:
        part: the object.
        selected: what was selected of it.
        first: the first yaw.
        count: number of cameras on the full circle.
        size: width and height of their pictures in pixels.
        pitches: further pitches in degrees.
    """
    judged, cameras = float(np.median(judged_pitches(part) or [_USUAL_PITCH_DEGREES])), list[Camera]()
    judged = float(np.clip(judged, -_MAX_PITCH_DEGREES, _MAX_PITCH_DEGREES))
    for number, pitch in ((count, judged), *((1, pitch) for pitch in pitches)):
        config = PlanConfig(views=number, size=size, pitch_degrees=pitch, yaw_range_degrees=(first, first + 360))
        cameras += plan_cameras(selected, part.bounds.axes[2], config)[0]
    zoom = min(zoom_to_whole(camera, part.gaussians) for camera in cameras)
    return [(first + 360 * i // count) % 360 for i in range(count)], [zoomed(c, zoom) for c in cameras]


def _past_what_hides(camera: Camera, scene: Gaussians, bounds: Bounds) -> Camera:
    """Return a camera that sees nothing before the surroundings of an object, nor what in these hides its place."""
    place, corner_depths = camera.project(bounds.corners())
    depths = camera.to_camera(scene.means.astype(np.float64))[:, 2]
    near = max(camera.near, float(np.linalg.norm(camera.centre - bounds.centre)) - CONTEXT_RADIUS * bounds.radius)
    camera, front = replace(camera, near=near), float(corner_depths.min())
    before = scene.select((depths > near) & (depths < front))
    x0, y0, x1, y1 = np.clip([*place.min(axis=0), *place.max(axis=0)], 0, camera.width - 1).astype(int)
    if not len(before) or render(before, camera).alpha[y0 : y1 + 1, x0 : x1 + 1].mean() < _HIDING_ALPHA:
        return camera
    return replace(camera, near=front)


def zoom_to_whole(camera: Camera, gaussians: Gaussians) -> float:
    """By how much a picture must be widened to show all Gaussians, at most 1; robust bounds leave out thin ends."""
    pixels, depth = camera.project(gaussians.means.astype(np.float64))
    half = np.array([camera.width, camera.height]) / 2
    seen = np.asarray(depth > camera.near)
    farthest = float(np.abs(pixels[seen] / half - 1).max(initial=0.0))
    return float(np.clip(1 / max(_WHOLE_OBJECT_MARGIN * farthest, 1.0), _SMALLEST_ZOOM, 1.0))


def _headings(yaws: Sequence[int], pitches: Sequence[float], verdicts: Sequence[str], width: int) -> Picture:
    """A line over the columns: from where each looks, and why that side was not judged; no view judges the pitches."""
    heights = [f"from {'high' if p > _USUAL_PITCH_DEGREES else 'low'}, {p:.0f} deg up" for p in pitches]
    places = [*(f"{yaw} deg: checked" for yaw in yaws), *heights]
    words = [
        (f"{place.partition(':')[0]}: not checked, {verdict}", _REJECTED_COLOUR) if verdict else (place, _TEXT_COLOUR)
        for place, verdict in zip(places, verdicts, strict=True)
    ]
    edges = np.linspace(0, width, len(words) + 1).astype(int)
    return np.hstack([_strip([word], b - a) for word, a, b in zip(words, edges, edges[1:], strict=False)])


def zoomed(camera: Camera, zoom: float) -> Camera:
    """The camera with its picture made smaller about the picture's middle, which need not be the principal point."""
    shrink = np.array([[zoom, 0, (1 - zoom) * camera.width / 2], [0, zoom, (1 - zoom) * camera.height / 2], [0, 0, 1]])
    return replace(camera, K=shrink @ camera.K)


def captioned(caption: str, picture: Picture) -> Picture:
    """A picture with a line of text above it."""
    return np.vstack([_strip([(caption, _TEXT_COLOUR)], picture.shape[1]), picture])


def write_picture(picture: Picture, path: Path) -> None:
    """Write a picture in the format of the file's name.

    Raises:
        InputError: the file cannot be written.
    """
    done, data = cv2.imencode(path.suffix, picture)
    if not done:
        raise InputError(f"Cannot write '{path}': no picture format has the ending '{path.suffix}'.")
    write_whole(path, data.tobytes())


def _row(caption: str, gaussians: Gaussians, cameras: Sequence[Camera], verdicts: Sequence[str]) -> Picture:
    pictures = list(parallel_map(lambda camera: draw_gaussians(gaussians, camera), cameras))
    for picture, verdict in zip(pictures, verdicts, strict=True):
        if verdict:
            _frame(picture)
    return captioned(caption, side_by_side(pictures))


def side_by_side(pictures: Sequence[Picture]) -> Picture:
    """Return pictures of one height in a row."""
    gap = np.full((len(pictures[0]), _GAP_PIXELS, 3), _STRIP_COLOUR, np.uint8)
    return np.hstack([cell for picture in pictures for cell in (gap, picture)][1:])


def _background_around(result: TrimResult, part: TrimmedObject) -> Gaussians:
    """Return the scene without the objects, of a very large one what lies nearest to one of them."""
    rows = result.rest.rows
    if len(rows) <= _MOST_DRAWN:
        return result.background
    distances = np.linalg.norm(result.scene.means[rows] - part.bounds.centre.astype(np.float32), axis=1)
    nearest = np.sort(np.argpartition(distances, _MOST_DRAWN)[:_MOST_DRAWN])
    return concatenate([result.scene.select(rows[nearest]), result.rest.appended])


def nearby_background(result: TrimResult, part: TrimmedObject) -> Gaussians:
    """Return what of the background lies around an object: walls farther out would stand before a camera."""
    scene, appended = result.scene, result.rest.appended
    near = nearby_rows(scene, result.rest.rows, part.bounds)
    new = nearby_rows(appended, np.arange(len(appended)), part.bounds)
    return concatenate([scene.select(near), appended.select(new)])


def nearby_scene(result: TrimResult, part: TrimmedObject) -> Gaussians:
    """Return the scene around an object as it was before the trim, the object included."""
    near = nearby_rows(result.scene, np.arange(len(result.scene)), part.bounds)
    return result.scene.select(np.union1d(near, part.source_index))


def nearby_rows(scene: Gaussians, rows: IntArray, bounds: Bounds) -> IntArray:
    """Return those of some rows of the scene that lie around an object."""
    offset = scene.means[rows] - bounds.centre.astype(np.float32)
    return np.asarray(rows[np.linalg.norm(offset, axis=1) < CONTEXT_RADIUS * bounds.radius])


def as_picture(rgb: FloatArray) -> Picture:
    """Colours from 0 to 1 (H, W, 3) as a picture."""
    return np.ascontiguousarray(np.clip(rgb[..., ::-1] * 255 + 0.5, 0, 255).astype(np.uint8))


def with_grid(picture: Picture) -> Picture:
    """A picture with lines at round pixel numbers, which stand at its upper and left edge."""
    height, width = picture.shape[:2]
    step = next((step for step in _GRID_STEPS if step * _GRID_LINES >= max(height, width)), _GRID_STEPS[-1])
    drawn = picture.copy()
    for x in range(step, width, step):
        cv2.line(drawn, (x, 0), (x, height - 1), _GRID_COLOUR, 1)
    for y in range(step, height, step):
        cv2.line(drawn, (0, y), (width - 1, y), _GRID_COLOUR, 1)
    drawn = np.asarray(cv2.addWeighted(drawn, 0.25, picture, 0.75, 0), np.uint8)
    for x in range(step, width, step):
        draw_number(drawn, x, (x + 2, 10))
    for y in range(step, height, step):
        draw_number(drawn, y, (2, y - 3))
    return drawn


def with_axes(picture: Picture, camera: Camera) -> Picture:
    """A picture with the axes of the scene in its lower left corner, to tell which one points up."""
    drawn, corner = picture.copy(), np.array([1.5 * _AXIS_PIXELS, len(picture) - 1.5 * _AXIS_PIXELS])
    for name, axis, colour in zip("xyz", camera.rotation.T[:, :2], np.eye(3)[::-1] * 155 + 100, strict=True):
        end = (corner + _AXIS_PIXELS * axis).round().astype(int).tolist()
        cv2.arrowedLine(drawn, corner.round().astype(int).tolist(), end, colour.tolist(), 2, cv2.LINE_AA, tipLength=0.2)
        draw_number(drawn, name, (end[0] + 3, end[1] + 4))
    return drawn


def draw_number(picture: Picture, number: int | str, place: tuple[int, int], scale: float = _NUMBER_SCALE) -> None:
    """Write a number or a letter into a picture, to be read on any ground; `place`: its lower left corner, x and y."""
    for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(picture, str(number), place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thickness, cv2.LINE_AA)


def _frame(picture: Picture) -> None:
    """Draw the frame of what was not judged."""
    cv2.rectangle(picture, (0, 0), (picture.shape[1] - 1, picture.shape[0] - 1), _REJECTED_COLOUR, 3)


def _draw_outline(picture: Picture, mask: BoolArray, colour: Colour, thickness: int) -> None:
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, colour, thickness, cv2.LINE_AA)


def _strip(words: Sequence[tuple[str, Colour]], width: int) -> Picture:
    """A line of coloured words, made small enough to fit the width."""
    strip = np.full((_LINE_HEIGHT, width, 3), _STRIP_COLOUR, np.uint8)
    font, gap = cv2.FONT_HERSHEY_SIMPLEX, 18
    widths = [cv2.getTextSize(text, font, _FONT_SCALE, 1)[0][0] for text, _ in words]
    scale = _FONT_SCALE * min(1.0, (width - 16 - gap * (len(words) - 1)) / max(sum(widths), 1))
    x = 8
    for text, colour in words:
        cv2.putText(strip, text, (x, _LINE_HEIGHT - 8), font, scale, colour, 1, cv2.LINE_AA)
        x += cv2.getTextSize(text, font, scale, 1)[0][0] + gap
    return strip
