"""A capture seen by fewer Gaussians: some of a dense scene, enlarged, fitted to pictures of the whole of it.

Unlike the trimmer's own fit, which keeps every Gaussian near where it began, this one is free: it stands for the
training of a capture, with the rates of 3D Gaussian Splatting, and its Gaussians end up across outlines as there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import (
    SH_C0,
    Float64Array,
    FloatArray,
    Gaussians,
    concatenate,
    logit,
    rotation_matrices,
)
from gaussian_trimmer.rendering.gradients import gradients, loss_gradient
from gaussian_trimmer.rendering.projection import as_tiles
from gaussian_trimmer.rendering.tile_renderer import Drawing, draw

VIEWS_PER_STEP = 2
HUBER_WIDTH = 0.03
"""Difference at a pixel from which on it counts in proportion rather than by its square."""
ALPHA_WEIGHT = 0.3
"""How much a difference of alpha counts against one of colour."""
MEAN_DECAY, SQUARE_DECAY = 0.9, 0.99
LEAST_GAIN = 1e-3
"""Change of the loss, in pixels, by one step of a parameter, that counts as nothing to go by."""
LAST_STEP_SHARE = 0.05
"""Length of the last step relative to the first."""
RATES = np.repeat(np.array([0.03, 0.012, 0.008, 0.05, 0.015, 0.002], np.float32), [3, 3, 3, 1, 3, 9])
"""First steps of mean (in sizes of the Gaussian), log-scales, turn (radians), opacity logit, sh_dc and degree 1."""
POSE_PIXELS, EXPOSURE, BALANCE, NOISE = 0.5, 0.04, 0.015, 0.02
"""Standard deviations of what is wrong with a photograph: shift, logarithms of gains, and noise of colours."""
SH_C1 = 0.4886025119029199
FAINTEST = 0.005
"""Opacity below which training removes a Gaussian."""
DETAIL_SHARE = 0.7
"""How many of the Gaussians go where the pictures have detail, rather than evenly over them."""
GROWTH_POWER = 0.45
"""Power of the number of Gaussians that one stands for, by which it is larger: between surfaces and volumes."""
PLACE_NOISE = 0.3
"""Noise of the first places, in sizes of the Gaussian."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera, and what it should show."""

    camera: Camera
    picture: FloatArray
    """Colour, premultiplied by alpha, and alpha, (4, H, W)."""


def photograph(
    seen_from: Callable[[Camera], Gaussians], cameras: Sequence[Camera], flaws: float, rng: np.random.Generator
) -> list[View]:
    """Pictures of what each camera saw, as flawed as photographs are: exposure, balance, noise, poses somewhat off."""
    views = []
    for camera in cameras:
        K = camera.K.copy()
        K[:2, 2] += flaws * POSE_PIXELS * rng.normal(size=2)
        picture = draw(seen_from(camera), [replace(camera, K=K)]).images[0].copy()
        gains = np.exp(flaws * (EXPOSURE * rng.normal() + BALANCE * rng.normal(size=3)))
        picture[:3] *= gains[:, None, None]
        picture[:3] += flaws * NOISE * rng.normal(size=picture[:3].shape)
        views.append(View(camera, picture))
    return views


def shrunk(view: View, scale: float) -> View:
    """The same view on a smaller picture."""
    camera = view.camera.resized(scale)
    picture = np.ascontiguousarray(view.picture.transpose(1, 2, 0))
    resized = cv2.resize(picture, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return View(camera, np.ascontiguousarray(resized.transpose(2, 0, 1), np.float32))


def thinned(scene: Gaussians, views: Sequence[View], count: int, rng: np.random.Generator) -> Gaussians:
    """Some Gaussians of a scene, enlarged to cover what all of them do, with SH degree 1.

    They are drawn by the sum of their blend weights, more of them where the pictures have detail, since training
    splits Gaussians there; each is larger the fewer of its like are drawn, and somewhat off its place.
    """
    shown = np.zeros(len(scene))
    for view in views:
        shown += draw(scene, [view.camera]).weigh([_detail(view.picture)[None]])[0, :, 0]
    visible = np.flatnonzero(shown > 0)
    count = min(count, len(visible))
    share = shown[visible] / shown[visible].sum()
    rows = visible[rng.choice(len(visible), count, replace=False, p=share)]
    growth = np.maximum(1, shown[visible].sum() / (count * shown[rows])) ** GROWTH_POWER
    chosen = scene.select(rows)
    scales = chosen.scales * np.minimum(growth, np.percentile(growth, 98))[:, None]
    noise = np.einsum("nij,nj->ni", rotation_matrices(chosen.quaternions), PLACE_NOISE * scales * _normal(rng, count))
    rest = np.zeros((count, 3, 3), np.float32)
    known = min(3, chosen.sh_rest.shape[2])
    rest[:, :, :known] = chosen.sh_rest[:, :, :known] / 2
    return chosen.replace(means=chosen.means + noise, log_scales=np.log(scales), sh_rest=rest, extras={})


def fit(gaussians: Gaussians, views: Sequence[View], steps: int, rng: np.random.Generator) -> Gaussians:
    """The Gaussians after steps of Adam towards the views; those that become fainter than training keeps are gone."""
    sizes = np.exp(gaussians.log_scales.mean(axis=1, keepdims=True))
    rates = np.repeat(RATES[None], len(gaussians), axis=0)
    rates[:, :3] *= sizes
    mean, square = np.zeros_like(rates), np.zeros_like(rates)
    everything = np.ones(len(gaussians), np.bool_)
    waiting: list[int] = []
    for step in range(steps):
        gradient = np.zeros_like(rates)
        for _ in range(VIEWS_PER_STEP):
            waiting = waiting or rng.permutation(len(views)).tolist()
            view = views[waiting.pop()]
            drawing = draw(gaussians, [view.camera])
            weight = np.ones_like(view.picture)
            weight[3] = ALPHA_WEIGHT
            slopes = loss_gradient(drawing, as_tiles(view.picture), as_tiles(weight), HUBER_WIDTH)
            of_view = gradients(drawing, slopes, everything)[0]
            gradient += np.concatenate([of_view, _by_degree_one(gaussians, view.camera, of_view[:, 10:])], axis=1)
        gradient *= rates  # so that all parameters are measured in their steps
        mean = MEAN_DECAY * mean + (1 - MEAN_DECAY) * gradient
        square = SQUARE_DECAY * square + (1 - SQUARE_DECAY) * gradient**2
        length = np.sqrt(square / (1 - SQUARE_DECAY ** (step + 1))) + LEAST_GAIN
        change = -(LAST_STEP_SHARE ** (step / steps)) * rates * (mean / (1 - MEAN_DECAY ** (step + 1)) / length)
        gaussians = _changed(gaussians, change.astype(np.float32))
    return gaussians.select(gaussians.opacities > FAINTEST)


def floaters(scene: Gaussians, views: Sequence[View], n: int, rng: np.random.Generator) -> Gaussians:
    """Large faint Gaussians at random places between the cameras and what they see, in colours of the pictures."""
    parts = []
    for view, of_view in zip(views, rng.multinomial(n, np.full(len(views), 1 / len(views))), strict=True):
        camera, drawing = view.camera, draw(scene, [view.camera])
        size = [camera.width, camera.height]
        pixels = rng.integers(0, size, (of_view, 2))
        others = rng.integers(0, size, (of_view, 2))
        depths = drawing.depth[0][pixels[:, 1], pixels[:, 0]] * rng.uniform(0.2, 0.95, of_view)
        rays = camera.ray_directions(np.asarray(pixels + 0.5, np.float64))
        means = camera.centre + rays * (depths / (rays @ camera.forward))[:, None]
        scales = (depths * np.exp(rng.uniform(np.log(0.008), np.log(0.06), of_view)))[:, None] + 1e-4
        colours = view.picture[:3, others[:, 1], others[:, 0]].T + 0.08 * _normal(rng, of_view)
        parts.append(
            coloured(means, scales * np.exp(0.4 * _normal(rng, of_view)), colours, rng.uniform(0.03, 0.2, of_view))
        )
    made = concatenate(parts)
    return made.replace(quaternions=rng.normal(size=(len(made), 4)))


def coloured(means: Float64Array, scales: Float64Array, colours: Float64Array, opacities: Float64Array) -> Gaussians:
    """Unturned Gaussians of colours that are the same from all sides, with zeros for SH degree 1."""
    n = len(means)
    turns = np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1))
    sh_dc = (colours - 0.5) / SH_C0
    return Gaussians(means, np.log(scales), turns, logit(opacities), sh_dc, np.zeros((n, 3, 3)))  # type: ignore[arg-type]


def psnr(drawing: Drawing, picture: FloatArray) -> float:
    """Likeness of a view's colours, clipped to [0, 1], to a picture (3, H, W), in decibels."""
    return float(-10 * np.log10(np.mean((np.clip(drawing.images[0][:3], 0, 1) - picture) ** 2)))


def _detail(picture: FloatArray) -> FloatArray:
    """How many Gaussians a picture asks for at each of its pixels, with mean one, (H, W)."""
    slopes = [cv2.Sobel(channel, cv2.CV_32F, *axis) for channel in picture[:3] for axis in ((1, 0), (0, 1))]
    strength = cv2.GaussianBlur(np.sqrt(np.sum(np.square(slopes), axis=0)), (0, 0), 1.5)
    return np.asarray(1 - DETAIL_SHARE + DETAIL_SHARE * strength / strength.mean(), np.float32)


def _by_degree_one(gaussians: Gaussians, camera: Camera, by_constant: FloatArray) -> FloatArray:
    """Derivatives by the coefficients of degree 1, (N, 9), from those by the constant ones, (N, 3)."""
    directions = gaussians.means - camera.centre
    x, y, z = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
    basis = np.stack([-y, z, -x], axis=1) * (SH_C1 / SH_C0)
    return np.asarray((by_constant[:, :, None] * basis[:, None]).reshape(-1, 9), np.float32)


def _changed(gaussians: Gaussians, change: FloatArray) -> Gaussians:
    q = gaussians.quaternions / np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True)
    w, v, half = q[:, :1], q[:, 1:], change[:, 6:9] / 2
    turned = np.concatenate([w - np.sum(v * half, axis=1, keepdims=True), v + w * half + np.cross(v, half)], axis=1)
    return Gaussians(
        gaussians.means + change[:, :3],
        gaussians.log_scales + change[:, 3:6],
        turned,
        gaussians.opacity_logits + change[:, 9],
        gaussians.sh_dc + change[:, 10:13],
        gaussians.sh_rest + change[:, 13:].reshape(-1, 3, 3),
    )


def _normal(rng: np.random.Generator, n: int) -> Float64Array:
    return rng.normal(size=(n, 3))
