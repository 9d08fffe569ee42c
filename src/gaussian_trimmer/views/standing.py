"""Where a person would stand in a capture of rooms."""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.cameras import Camera, look_at, up_frame
from gaussian_trimmer.gaussians import Float64Array, FloatArray, Gaussians, IntArray
from gaussian_trimmer.geometry.storey import find_storey, sampled
from gaussian_trimmer.rendering import render
from gaussian_trimmer.views.view import HALF

_EYE_SHARE, _FREE_SHARE, _NOD = 0.6, 0.5, 0.2
"""How high an eye is between floor and ceiling; what is nearer than this share of the room's height stands in the way;
how far down the eye looks."""
_STANDS, _TRIED, _YAWS, _MOST_PIXELS = 20, 3, 8, 1.0
"""Places, the freest of so many times as many, and directions that are tried; pixels that a Gaussian counts for at
most: many are many things."""
TRIED_GAUSSIANS = 40_000
"""Gaussians that are drawn on trial at most, larger as they are fewer."""
_STAND_PIXELS, _STAND_K = (96, 64), np.array([[60.0, 0, 48], [0, 60, 32], [0, 0, 1]])


def stands_in_rooms(scene: Gaussians, up: Float64Array, count: int = 1) -> list[tuple[Float64Array, Float64Array]]:
    """Return from where a person sees most of what is below the eyes, and towards what, (3,) each; nothing outdoors.

    Args:
        scene: all N Gaussians.
        up: the up vector, (3,).
        count: number of looks at most; each shows most of what those before it do not.
    """
    scene = sampled(scene)
    storey = find_storey(scene, up)
    if storey.ceiling is None or not storey.is_room:
        return []
    thin = max(1, len(scene) // TRIED_GAUSSIANS)
    scene = thinned(scene, np.arange(len(scene)), thin)
    room, heights, axes = storey.ceiling - storey.floor, scene.means @ up, up_frame(up)
    below = (heights > storey.floor) & (heights < storey.floor + _EYE_SHARE * room)
    if not below.any():
        return []
    feet = np.random.default_rng(0).choice(scene.means[below].astype(np.float64), _TRIED * _STANDS)
    eyes = feet + (storey.floor + _EYE_SHARE * room - feet @ up)[:, None] * up
    around = [(np.linalg.norm(scene.means - eye, axis=1) < _FREE_SHARE * room).sum() for eye in eyes]
    eyes = eyes[np.argsort(around, kind="stable")[:_STANDS]]
    targets = [
        room * (np.cos(yaw) * axes[0] + np.sin(yaw) * axes[1] - _NOD * up)
        for yaw in np.arange(_YAWS) * 2 * np.pi / _YAWS
    ]
    shown = np.zeros((_STANDS, _YAWS, int(below.sum())), np.float32)  # what counts of each Gaussian
    blocked = np.zeros((_STANDS, _YAWS), np.bool_)  # more of a picture shows what stands in the way than the rest
    for place, eye in enumerate(eyes):
        for turn, target in enumerate(targets):
            camera = Camera(look_at(eye, eye + target, up), _STAND_K, *_STAND_PIXELS, near=room / 100)
            weights, in_the_way, free = seen_shares(scene, camera, _FREE_SHARE * room)
            blocked[place, turn] = in_the_way > free
            shown[place, turn] = free * np.minimum(weights[below], _MOST_PIXELS)
    # A person stands where most looks are free, and does not look at what stands in the way.
    shown[blocked | (blocked.mean(axis=1) >= HALF)[:, None]] = 0
    found, known = [], np.zeros(shown.shape[2], np.float32)
    for _ in range(count):
        new = np.maximum(shown - known, 0).sum(axis=2)  # (places, directions)
        place, turn = divmod(int(np.argmax(new)), _YAWS)
        if new[place, turn] <= 0:
            break
        found.append((eyes[place], eyes[place] + targets[turn]))
        known = np.maximum(known, shown[place, turn])
    return found


def seen_shares(scene: Gaussians, camera: Camera, reach: float) -> tuple[FloatArray, float, float]:
    """Return what each Gaussian fills of a picture, in pixels, (N,), and the shares that what is near and far fills.

    What is within reach of the camera stands in the way, a haze included.
    """
    weights = render(scene, camera, weights=True).weights
    near = np.linalg.norm(scene.means - camera.centre.astype(np.float32), axis=1) < reach
    pixels = camera.width * camera.height
    return weights, float(weights[near].sum()) / pixels, float(weights[~near].sum()) / pixels


def thinned(scene: Gaussians, rows: IntArray, step: int) -> Gaussians:
    """Return every `step`-th of some Gaussians, by scene rows, larger so that they cover as much; of none, none."""
    step = max(1, step)
    some = scene.select(rows[::step])
    return some.replace(log_scales=some.log_scales + np.float32(np.log(step) / 2))
