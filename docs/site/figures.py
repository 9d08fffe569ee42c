"""The figures of `docs/stages.md`, made by the program from its sample scene.

    python docs/site/figures.py [FOLDER]

Without FOLDER they replace those in `docs/images/stages`.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.cameras import Camera, intrinsics, look_at, up_frame
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, concatenate, logit
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.split import split_plane
from gaussian_trimmer.output.pictures import (
    BACKDROP,
    Picture,
    as_picture,
    captioned,
    draw_view,
    write_picture,
)
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.rendering.tile_renderer import draw
from gaussian_trimmer.trimming.alpha_targets import OutlineViews, coverage_targets
from gaussian_trimmer.trimming.result import RowLabel, TrimResult

FOLDER = Path(__file__).parents[1] / "images" / "stages"
SIDE = 300
KEPT, REMOVED, ADDED, OTHER = (0.25, 0.7, 0.3), (0.95, 0.2, 0.1), (0.2, 0.45, 1.0), (0.82, 0.82, 0.82)
BLUE, ORANGE = (0.1, 0.4, 0.9), (0.95, 0.5, 0.1)


def figures(size: int = 512) -> dict[str, Picture]:
    """Every figure by the name of its file; `size` is that of the virtual views in pixels."""
    scene = gt.read(sample.SCENE)
    rough = gt.read_selection(sample.SELECTION, scene)
    config = gt.TrimConfig.of({"plan.size": size})
    result = gt.trim(scene, rough, cameras=gt.read_cameras(sample.CAMERAS), config=config)
    return {
        "planning.jpg": _planning(result),
        "augmentation.jpg": _augmentation(result),
        "labels.jpg": _labels(result),
        "segmentation.jpg": _segmentation(result),
        "evidence.jpg": _evidence(result),
        "splitting.jpg": _splitting(),
        "refinement.jpg": _refinement(scene, rough, config),
    }


def row_of_pictures(cells: list[tuple[str, FloatArray]]) -> Picture:
    """Pictures (H, W, 3) in [0, 1] of one height side by side, with their names above."""
    return np.hstack([captioned(name, as_picture(rgb)) for name, rgb in cells])


def _planning(result: TrimResult) -> Picture:
    """A map of the cameras, and what three of them see."""
    views = [(f"view {i}", _small(result.objects[0].views[i].view.rgb)) for i in (0, 1, 2)]
    return row_of_pictures([("from above", _map(result)), *views])


def _map(result: TrimResult) -> FloatArray:
    """The selected Gaussians, those around them, and the cameras, seen along the up vector."""
    across, along, _ = up_frame(result.objects[0].up.direction)
    centres = np.array([view.view.camera.centre for view in result.objects[0].views])
    reach = 1.2 * np.linalg.norm(centres - result.objects[0].bounds.centre, axis=1).max()
    picture = np.ones((SIDE, SIDE, 3), np.float32)

    def at(points: FloatArray | Float64Array) -> np.ndarray:
        offset = np.asarray(points, np.float64) - result.objects[0].bounds.centre
        plane = np.stack([offset @ across, -(offset @ along)], -1)
        return np.asarray(np.round(SIDE * (0.5 + plane / (2 * reach))), np.int64)

    for rows, colour in ((~result.selection, OTHER), (result.selection, ORANGE)):
        pixels = at(result.scene.means[rows])
        inside = ((pixels >= 0) & (pixels < SIDE)).all(axis=1)
        picture[pixels[inside, 1], pixels[inside, 0]] = colour
    middle = at(result.objects[0].bounds.centre[None])[0]
    for centre in at(centres):
        cv2.line(picture, centre.tolist(), middle.tolist(), (0.6, 0.7, 0.9), 1, cv2.LINE_AA)
        cv2.circle(picture, centre.tolist(), 6, BLUE, -1, cv2.LINE_AA)
    return picture


def _augmentation(result: TrimResult) -> Picture:
    """A view of the selection alone, and with the Gaussians around it."""
    view = result.objects[0].views[0].view
    alone = render(result.scene.select(result.selection), view.camera, BACKDROP).rgb
    around = view.rgb + (1 - view.alpha)[..., None] * BACKDROP
    cells = [("the selection alone", _small(alone)), ("with the Gaussians around it (BA)", _small(around))]
    return row_of_pictures(cells)


def _labels(result: TrimResult) -> Picture:
    """How much of the picture the object contributes, by the given labels and by the corrected ones."""
    view = result.objects[0].views[0].view
    cells = [("picture", _small(view.rgb)), ("given labels", _small(_grey(view.object_visible)))]
    return row_of_pictures([*cells, ("corrected labels", _small(_grey(view.object_prior)))])


def _segmentation(result: TrimResult) -> Picture:
    """Three views as they are written to `views/`."""
    pictures = [draw_view(view, i) for i, view in enumerate(result.objects[0].views)][:3]
    return np.hstack(
        [np.asarray(cv2.resize(p, None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA)) for p in pictures]
    )


def _evidence(result: TrimResult) -> Picture:
    """What became of each Gaussian: kept, removed or added."""
    colours = np.tile(np.array(OTHER, np.float32), (len(result.scene), 1))
    for label, colour in ((RowLabel.KEPT, KEPT), (RowLabel.ADDED, ADDED)):
        colours[result.objects[0].source_index[result.objects[0].label == label]] = colour
    colours[result.background_source[result.background_label == RowLabel.REMOVED]] = REMOVED
    cells = []
    for i in (0, 1, 2):
        camera = _close_up(result.objects[0].views[i].view.camera, result.objects[0].bounds)
        rows = result.selection | result.object_mask
        shown = blend_values(result.scene.select(rows), camera, colours[rows])
        alpha = render(result.scene.select(rows), camera).alpha
        cells.append((f"view {i}: kept, removed, added", shown + (1 - alpha)[..., None]))
    return row_of_pictures(cells)


def _close_up(camera: Camera, bounds: Bounds) -> Camera:
    """A camera with its image cut to a square about the object and enlarged."""
    corners, _ = camera.project(bounds.corners())
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = 0.6 * float((high - low).max())
    corner, scale = (low + high) / 2 - half, SIDE / (2 * half)
    crop = np.array([[scale, 0, -scale * corner[0]], [0, scale, -scale * corner[1]], [0, 0, 1]])
    return replace(camera, K=crop @ camera.K, width=SIDE, height=SIDE)


def _splitting() -> Picture:
    """One Gaussian, and its children on both sides of a plane, each rendered alone, and both together."""
    parent = Gaussians(
        means=np.zeros((1, 3), np.float32),
        log_scales=np.log(np.array([[0.36, 0.12, 0.12]], np.float32)),
        quaternions=np.array([[np.cos(0.25), 0, 0, np.sin(0.25)]], np.float32),
        opacity_logits=logit(np.array([0.95])).astype(np.float32),
        sh_dc=np.array([[0.2, 0.6, 1.4]], np.float32),
        sh_rest=np.zeros((1, 3, 0), np.float32),
    )
    inside, outside = split_plane(parent, np.array([[1.0, 0.0, 0.0]]), np.array([0.1]))
    eye = np.array([0.0, 0.0, -2.4])
    camera = Camera(
        look_at(eye, np.zeros(3), np.array([0.0, -1, 0])), intrinsics(np.radians(45), SIDE, SIDE), SIDE, SIDE
    )
    both = concatenate([inside, outside])
    named = [("parent", parent), ("inside child", inside), ("outside child", outside), ("both children", both)]
    cells = [(name, render(g, camera, BACKDROP).rgb) for name, g in named]
    return row_of_pictures(cells)


def _refinement(scene: Gaussians, rough: BoolArray, config: gt.TrimConfig) -> Picture:
    """Opacity of the object alone without the fit, the coverage aimed at, and opacity after the fit, enlarged."""
    cameras = gt.read_cameras(sample.CAMERAS)
    before = gt.trim(scene, rough, cameras=cameras, config=replace(config, refine="off"))
    after = gt.trim(scene, rough, cameras=cameras, config=config)
    camera = before.objects[0].views[0].view.camera.resized(SIDE / before.objects[0].views[0].view.camera.width)
    views = OutlineViews([camera], None, before.objects[0].bounds.radius)
    rendered = views.render(before.object, before.background, colours=True)
    shown = [rendered.alone.alpha[0], coverage_targets(rendered)[0].picture[3], draw(after.object, [camera]).alpha[0]]
    return row_of_pictures([(name, _grey(a)) for name, a in zip(("before", "aim", "after"), shown, strict=True)])


def _grey(values: FloatArray) -> FloatArray:
    return np.repeat(np.clip(values, 0, 1)[..., None], 3, axis=2)


def _small(rgb: FloatArray) -> FloatArray:
    return np.asarray(cv2.resize(np.clip(rgb, 0, 1), (SIDE, SIDE), interpolation=cv2.INTER_AREA))


def main(folder: Path) -> None:
    """Write every figure to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in figures().items():
        write_picture(picture, folder / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
