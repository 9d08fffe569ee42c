"""Small random scenes and cameras in which some numbers are as large, as small or as meaningless as numbers can be."""

from dataclasses import replace

import numpy as np
from scenes import front_camera, random_scene

SIZES = ((1, 1), (16, 16), (33, 20), (48, 47))
LOG_SCALES = (-3e38, -300.0, -60.0, 12.0, 18.5, 25.0, 44.0, 48.0, 60.0, 88.0, 90.0, 200.0, 356.0, 500.0, 720.0, 3e38)
COORDINATES = (0.0, 1e-38, 1e6, 1e12)
FAR_COORDINATES = (1e19, 1e25, 3e38)
QUATERNIONS = (0.0, 1e-38, 1e-20, 1e20, 3e38)
LOGITS = (-3e38, -1e4, 1e4, 3e38)
COEFFICIENTS = (1e10, 1e30, 3e38)
FOCALS = (1e-300, 1e-30, 1e-3, 1e9, 1e30, 1e300)
POINTS = (-1e300, -1e9, 1e9, 1e300)
NEARS = (-1.0, 0.0, 1e-300, 1e9, 1e30)
MEANINGLESS = (np.nan, np.inf, -np.inf)


def extreme_scene(seed, coordinates=COORDINATES, others=()):
    """24 Gaussians of which some numbers are extreme: of every third seed few, of every third half of them.

    `others` are numbers that may stand anywhere.
    """
    rng = np.random.default_rng(seed)
    share = (0.02, 0.1, 0.5)[seed % 3]
    scene = random_scene(seed, 24, sh_degree=seed % 4)

    def spoilt(values, extremes):
        choices = np.array([*extremes, *(-extreme for extreme in extremes), *others])
        return np.where(rng.random(values.shape) < share, rng.choice(choices, values.shape), values).astype(np.float32)

    return scene.replace(
        means=spoilt(scene.means, coordinates),
        log_scales=spoilt(scene.log_scales, LOG_SCALES),
        quaternions=spoilt(scene.quaternions, QUATERNIONS),
        opacity_logits=spoilt(scene.opacity_logits, LOGITS),
        sh_dc=spoilt(scene.sh_dc, COEFFICIENTS),
        sh_rest=spoilt(scene.sh_rest, COEFFICIENTS),
    )


def extreme_camera(seed, others=()):
    """A camera of a few pixels; of every other seed its lens and its near plane are extreme, or one of the `others`."""
    rng = np.random.default_rng(seed)
    camera = front_camera(*SIZES[rng.integers(len(SIZES))])
    if seed % 2 == 0:
        return camera
    K = camera.K.copy()
    K[[0, 1], [0, 1]] = rng.choice([K[0, 0], *FOCALS, *others], 2)
    K[:2, 2] = rng.choice([0.5, *POINTS, *others], 2)
    return replace(camera, K=K, near=float(rng.choice([0.01, *NEARS])))


def huge_gaussians(seed, n=60):
    """Gaussians around the middle of the view of `front_camera`, half of them round, with log scales up to 88."""
    rng = np.random.default_rng(seed)
    scene = random_scene(seed, n, sh_degree=1)
    log_scales = rng.uniform(-2, 88, (n, 3))
    round_ones = rng.random(n) < 0.5
    log_scales[round_ones] = log_scales[round_ones, :1]
    return scene.replace(
        log_scales=log_scales.astype(np.float32), opacity_logits=rng.normal(-3, 1, n).astype(np.float32)
    )
