"""Random scenes and cameras for the tests of drawing, with ordinary numbers and with extreme ones."""

from dataclasses import replace

import numpy as np

from gaussian_trimmer.cameras import Camera, look_at
from gaussian_trimmer.gaussians import Gaussians, logit

SCENE_CENTRE = np.array([0.4, -0.3, 0.2])
SCENE_RADIUS = 1.0
CAMERA_POSITION = np.array([1.5, -1.4, -3.0])


def front_camera(width=83, height=61):
    """A tilted camera before the scene, with unequal focal lengths and the principal point off the centre."""
    focal = 1.1 * max(width, height)
    K = np.array([[focal, 0, 0.45 * width], [0, 1.05 * focal, 0.56 * height], [0, 0, 1.0]])
    world_to_camera = look_at(CAMERA_POSITION, SCENE_CENTRE, np.array([0.2, -1.0, 0.1]))
    return Camera(world_to_camera, K, width, height)


def gaussian(mean=(0, 0, 1), scale=0.1, quaternion=(1, 0, 0, 0), opacity=0.5, colour=(1, 1, 1), sh_rest=None):
    """One Gaussian; `scale` is one number or three, `colour` that of its constant coefficient."""
    return Gaussians(
        np.array([mean], np.float32),
        np.log(np.broadcast_to(scale, (1, 3))).astype(np.float32),
        np.array([quaternion], np.float32),
        logit(np.array([opacity])).astype(np.float32),
        ((np.array([colour]) - 0.5) / 0.28209479177387814).astype(np.float32),
        np.zeros((1, 3, 0), np.float32) if sh_rest is None else np.asarray(sh_rest, np.float32)[None],
    )


def random_scene(seed, n=160, sh_degree=3):
    """Gaussians of every kind that are easily drawn wrong, in random order, mostly before `front_camera`.

    The kinds, in turn: blobs, needles of aspect 1 : 100, crossers of the near plane, nearly opaque and nearly
    transparent ones, ones behind the camera, ones outside the image that may reach into it, pairs of equal depth, and
    a dense core that lets no light through.
    """
    rng = np.random.default_rng(seed)
    means = SCENE_CENTRE + SCENE_RADIUS * rng.uniform(-1, 1, (n, 3))
    log_scales = rng.uniform(np.log(0.03), np.log(0.25), (n, 3))
    opacities = rng.uniform(0.05, 0.95, n)
    kind = rng.permutation(n) % 8

    needles = kind == 1
    log_scales[needles] = np.log([0.4, 0.004, 0.004])
    crossers = kind == 2
    ahead = SCENE_CENTRE - CAMERA_POSITION
    near = rng.uniform(0.02, 0.3, (crossers.sum(), 1))
    means[crossers] = CAMERA_POSITION + near * ahead / np.linalg.norm(ahead) + rng.normal(0, 0.1, (crossers.sum(), 3))
    log_scales[crossers] = rng.uniform(np.log(0.005), np.log(0.2), (crossers.sum(), 3))
    opacities[crossers] *= 0.2  # They fill the image; opaque ones would hide the others.
    opacities[kind == 3] = rng.choice([0.0, 0.003, 0.005, 0.97, 0.995, 1.0], (kind == 3).sum())
    means[kind == 4] -= 2 * ahead
    sideways = np.cross(ahead, [0.0, 1.0, 0.0])
    means[kind == 5] += rng.choice([-1, 1], ((kind == 5).sum(), 1)) * sideways * rng.uniform(0.4, 2.0)
    log_scales[kind == 5] += 1.0
    twins = np.flatnonzero(kind == 6)
    means[twins[1::2]] = means[twins[::2][: len(twins) // 2]]
    core = kind == 7
    means[core] = SCENE_CENTRE + rng.uniform(-1, 1, (core.sum(), 3)) * [0.3, 0.3, 1.0]
    log_scales[core] = np.log(0.3)
    opacities[core] = rng.uniform(0.7, 0.95, core.sum())

    coefficients = (sh_degree + 1) ** 2 - 1
    return Gaussians(
        means.astype(np.float32),
        log_scales.astype(np.float32),
        rng.normal(0, 1, (n, 4)).astype(np.float32),
        logit(opacities).astype(np.float32),
        rng.normal(0, 1, (n, 3)).astype(np.float32),
        rng.normal(0, 0.3, (n, 3, coefficients)).astype(np.float32),
    )


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
