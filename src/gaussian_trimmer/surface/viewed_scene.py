"""A scene as the user sees it in one view: what clicks and boxes refer to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.rendering import blend_values, blend_weights, top_contributors

CONTRIBUTORS, _MIN_ALPHA = 10, 0.3
"""Number of the largest contributors to a pixel that are looked at, and least opacity at which something is visible."""
_MAX_SIDE_PIXELS = 640


@dataclass(frozen=True, eq=False)
class ViewedScene:
    """N Gaussians, the user's view of them, and what else is known of the scene."""

    gaussians: Gaussians
    camera: Camera
    up: Float64Array
    """The scene's up vector, (3,)."""
    seen_from: Sequence[Camera] = ()
    """Training cameras, if known: the scene is not looked at from other sides."""

    def small(self) -> ViewedScene:
        """Return the same in a view that is quick to render."""
        return replace(self, camera=small_view(self.camera))

    def coverage(self, selection: BoolArray) -> FloatArray:
        """Return the share of the picture that the selected Gaussians (N,) contribute, (H, W)."""
        return blend_values(self.gaussians, self.camera, selection.astype(np.float32)[:, None])[..., 0]

    def label_weights(self, mask: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Blend weight of each Gaussian outside a mask (H, W) and inside it, in pixels, (N,) each."""
        outside, inside = blend_weights(self.gaussians, self.camera, mask.astype(np.uint8), 2).T
        return outside, inside


@dataclass(frozen=True, eq=False)
class Target:
    """The point of the scene that a pixel shows."""

    point: Float64Array
    """World point, (3,)."""
    depth: float
    seeds: FloatArray
    """Blend weights at the pixel, (N,)."""


def small_view(camera: Camera) -> Camera:
    """Return the view at a size at which it is quick to render from all around."""
    return camera.resized(min(1.0, _MAX_SIDE_PIXELS / max(camera.width, camera.height)))


def shown_weight(gaussians: Gaussians, camera: Camera) -> FloatArray:
    """Blend weight of each Gaussian in a view, in pixels, (N,)."""
    labels = np.zeros((camera.height, camera.width), np.uint8)
    return blend_weights(gaussians, camera, labels, 1)[:, 0]


def check_pixel(camera: Camera, x: int, y: int) -> None:
    """Refuse a pixel outside the view.

    Raises:
        InputError: it is outside.
    """
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise InputError(f"The pixel ({x}, {y}) is outside the view of {camera.width} x {camera.height} pixels.")


def look_at_pixel(scene: ViewedScene, x: int, y: int) -> Target:
    """Return the surface point at a pixel, at the weighted median depth of the Gaussians that show there.

    Raises:
        InputError: the pixel is outside the view, or nothing is seen there.
    """
    check_pixel(scene.camera, x, y)
    targets = look_at_pixels(scene, np.array([[x, y]]))
    if not targets:
        raise InputError(f"Nothing is seen at the pixel ({x}, {y}); choose another one, or another view.")
    return targets[0]


def look_at_pixels(scene: ViewedScene, pixels: IntArray) -> list[Target]:
    """Return the surface points at those pixels of the view (P, 2) that show something, as `look_at_pixel` does."""
    camera, targets = scene.camera, list[Target]()
    contributors = top_contributors(scene.gaussians, camera, pixels, CONTRIBUTORS)
    depths = surface_depths(scene.gaussians, camera, *contributors)
    rays = camera.ray_directions(np.asarray(pixels + 0.5, np.float64))
    for rows, weights, depth, ray in zip(*contributors, depths.tolist(), rays, strict=True):
        if np.isfinite(depth):
            seeds = np.zeros(len(scene.gaussians), np.float32)
            seeds[rows[rows >= 0]] = weights[rows >= 0]
            targets.append(Target(camera.centre + ray * depth / (ray @ camera.forward), depth, seeds))
    return targets


def surface_points(gaussians: Gaussians, camera: Camera, pixels: IntArray) -> Float64Array:
    """Return points of the scene that show at some pixels (P, 2), NaN where hardly anything is visible, (P, 3)."""
    if not len(gaussians):
        return np.full((len(pixels), 3), np.nan)
    rows, weights = top_contributors(gaussians, camera, pixels, CONTRIBUTORS)
    depths = surface_depths(gaussians, camera, rows, weights)
    rays = camera.ray_directions(np.asarray(pixels + 0.5, np.float64))
    depths[np.isinf(depths)] = np.nan
    return np.asarray(camera.centre + rays * (depths / (rays @ camera.forward))[:, None])


def surface_depths(gaussians: Gaussians, camera: Camera, rows: IntArray, weights: NDArray[np.floating]) -> Float64Array:
    """Return the depth of the surface at some pixels, infinite where hardly anything is visible, (P,).

    It is the weighted median over the largest contributors, which does not mix thin objects with what is behind them.

    Args:
        rows: rows of the pixels' largest contributors, -1 for none, (P, K).
        weights: their blend weights, (P, K).
    """
    depths = camera.project(gaussians.means[np.maximum(rows, 0).ravel()].astype(np.float64))[1].reshape(rows.shape)
    depths, weights = np.where(rows < 0, np.inf, depths), np.where(rows < 0, 0, weights)
    order = np.argsort(depths, axis=1)
    cumulative = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    median = np.argmax(cumulative >= cumulative[:, -1:] / 2, axis=1)
    found = depths[np.arange(len(rows)), order[np.arange(len(rows)), median]]
    return np.where(cumulative[:, -1] < _MIN_ALPHA, np.inf, found)
