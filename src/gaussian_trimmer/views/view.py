"""A view: what one camera sees of an object, and the mask that was drawn in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.parallel import in_shares
from gaussian_trimmer.rendering import Rendering

HALF = 0.5
"""A pixel belongs to the object where the object's alpha, or its share of the picture, is above this."""

HALF_COVERAGE = 127
"""Coverage of a pixel from 0 to 255 above which it belongs to a mask."""

TOUCHING_RADII = 0.1
"""Distance in object radii within which what lies before the object touches it rather than hides it, and what lies
beside its bounds is within them."""

REFERENCE_PIXELS = 5 * 512 * 512
"""Pixels of the default views. Thresholds on summed blend weights hold for these, whatever views there are."""

MIN_SEEN_PIXELS = 1e-3
"""Summed blend weight above which a Gaussian counts as seen."""

_SEEN_DEVIATIONS = 3.0
"""Standard deviations from its centre up to which a Gaussian may show in a picture."""

Box = tuple[int, int, int, int]
"""Pixel box (x0, y0, x1, y1); x1 and y1 are exclusive."""


ViewMasks = list[tuple[Camera, BoolArray]]
"""Cameras, each with a mask of one object, (H, W)."""


@dataclass(frozen=True, eq=False)
class View:
    """What one camera sees of an object, and what is known of it there."""

    camera: Camera
    picture: Rendering
    """The object and the Gaussians around it, over black."""
    object_alpha: FloatArray
    """Alpha of the selected object rendered in isolation, (H, W)."""
    object_visible: FloatArray
    """Share of the picture that the selected object contributes: the sum of its Gaussians' blend weights, (H, W)."""
    object_prior: FloatArray
    """Share of the picture that the object contributes according to the corrected labels, (H, W)."""
    box: Box
    """Bounding box of the selected object rendered in isolation: the prompt of eq. 6."""
    hidden: BoolArray | None = None
    """Pixels of the selected object where something clearly nearer hides it, (H, W); None: there are none."""

    def __repr__(self) -> str:
        return f"<View: {self.camera.width} x {self.camera.height} pixels>"

    @property
    def rgb(self) -> FloatArray:
        """The picture to segment, over black; colours are not clipped above one, (H, W, 3)."""
        return self.picture.rgb

    @property
    def depth(self) -> FloatArray:
        """Depth of the picture in scene units, zero where nothing is seen, (H, W)."""
        return self.picture.depth

    @property
    def alpha(self) -> FloatArray:
        """Alpha of the picture, (H, W)."""
        return self.picture.alpha

    @property
    def hidden_share(self) -> float:
        """Share of the selected object's silhouette, as it is in isolation, that something nearer hides."""
        if self.hidden is None:
            return 0.0
        return float(np.count_nonzero(self.hidden) / max(int(np.count_nonzero(self.object_alpha > HALF)), 1))

    @property
    def silhouette(self) -> BoolArray:
        """Pixels that belong to the object according to the corrected labels, (H, W)."""
        return self.object_prior > HALF


@dataclass(frozen=True, eq=False)
class TrimmedView:
    """A view with its mask, and the verdict on the mask."""

    view: View
    mask: BoolArray
    """The mask of the object, (H, W)."""
    rejected: str | None
    """Why the mask was rejected; None if it was accepted."""
    judged: bool = True
    """Whether the mask was held against the silhouette of the labels; not where it is this silhouette."""

    def __repr__(self) -> str:
        rejected = f", rejected: {self.rejected}" if self.rejected else ""
        return f"<TrimmedView: {self.view!r}, mask of {np.count_nonzero(self.mask):,}{rejected}>"


def without_pictures(trimmed: TrimmedView) -> TrimmedView:
    """The camera of a view and what became of its mask, in little memory: all arrays are empty."""
    blank, view = np.zeros((0, 0), np.float32), trimmed.view
    picture = Rendering(np.zeros((0, 0, 3), np.float32), blank, blank)
    return TrimmedView(
        View(view.camera, picture, blank, blank, blank, view.box), blank > 0, trimmed.rejected, trimmed.judged
    )


def visible_weight(weights: Sequence[FloatArray] | FloatArray, cameras: Sequence[Camera]) -> FloatArray:
    """Sum blend weights over views, in pixels of five views of 512 x 512.

    Args:
        weights: blend weights in each view, in pixels of that view, of any shape.
        cameras: the cameras of all views, also of those without weights.
    """
    pixels = sum(camera.height * camera.width for camera in cameras)
    return np.asarray(np.sum(weights, axis=0) * np.float32(REFERENCE_PIXELS / pixels))


def shown_by(scene: Gaussians, cameras: Sequence[Camera], before: Bounds | None = None) -> BoolArray:
    """Return which Gaussians some camera may show, (N,), of all or nearer than the far end of some bounds."""
    ends = [
        np.inf if before is None else float(camera.project(before.centre[None])[1][0]) + before.radius
        for camera in cameras
    ]

    def shown(rows: slice) -> BoolArray:
        some = scene.select(rows)
        found, reach = np.zeros(len(some), np.bool_), _SEEN_DEVIATIONS * np.exp(some.largest_log_scales)
        means = np.ascontiguousarray(some.means.T, np.float64)
        for camera, far in zip(cameras, ends, strict=True):
            transform = camera.K @ camera.world_to_camera[:3]
            x, y, depths = np.einsum("ij,jn->in", transform[:, :3], means) + transform[:, 3:]
            half = camera.width / 2, camera.height / 2
            aside = np.maximum(*(np.abs(p - h * depths) - h * depths for p, h in zip((x, y), half, strict=True)))
            in_reach = aside < reach * max(camera.K[0, 0], camera.K[1, 1])
            found |= (depths > camera.near) & (depths < far) & in_reach
        return found

    return np.concatenate(in_shares(shown, len(scene)))


def clearly_nearer(nearest_depth: FloatArray, depth: FloatArray, radius: float) -> BoolArray:
    """Pixels at which something hides an object instead of touching it, (H, W).

    Args:
        nearest_depth: depth of what is seen, zero where nothing is, (H, W).
        depth: depth of the object by itself, (H, W).
        radius: the object's radius in scene units.
    """
    return np.asarray((nearest_depth > 0) & (nearest_depth < depth - TOUCHING_RADII * radius))


def mask_overlap(first: BoolArray, second: BoolArray) -> float:
    """Intersection over union of two masks (H, W); 0 if both are empty."""
    return int(np.count_nonzero(first & second)) / max(int(np.count_nonzero(first | second)), 1)


def grown(mask: BoolArray, radius: int) -> BoolArray:
    """A mask (H, W) and all pixels within a radius of it.

    >>> grown(np.array([[False, False, False, True]]), 1)
    array([[False, False,  True,  True]])
    """
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), disc) > 0)


def opened(mask: BoolArray, radius: int) -> BoolArray:
    """Return a mask (H, W) without what a square that reaches some pixels to all sides does not fit into."""
    square = np.ones((2 * radius + 1,) * 2, np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, square) > 0)


def bounding_box(mask: BoolArray, margin: int = 0) -> Box:
    """Bounding box of a mask (H, W), widened by `margin` pixels within the image; the whole image for an empty mask.

    >>> bounding_box(np.array([[False, False, False], [False, True, False]]))
    (1, 1, 2, 2)
    """
    height, width = mask.shape
    if not mask.any():
        return 0, 0, width, height
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x0, y0 = max(0, int(columns[0]) - margin), max(0, int(rows[0]) - margin)
    return x0, y0, min(width, int(columns[-1]) + 1 + margin), min(height, int(rows[-1]) + 1 + margin)


def box_slices(box: Box) -> tuple[slice, slice]:
    """Rows and columns of a box, to index an image with."""
    x0, y0, x1, y1 = box
    return slice(y0, y1), slice(x0, x1)
