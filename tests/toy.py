"""A red ball on a checkered floor, made of Gaussians whose true labels are known, rough selections of it, and trims."""

import json
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numba
import numpy as np

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import SH_C0, Gaussians, concatenate, logit, quaternions_of, rotation_matrices
from gaussian_trimmer.rendering import Rendering
from gaussian_trimmer.selecting.marks import Sphere
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim, views_to_segment
from gaussian_trimmer.views.view import TrimmedView, View, bounding_box
from gaussian_trimmer.views.virtual_cameras import PlanConfig

UP = np.array([0.0, 0.0, 1.0])
CENTRE = np.array([0.0, 0.0, 1.0])
RADIUS = 1.0
BALL = Sphere((0.0, 0.0, 1.0), 1.2)
TOP = Sphere((0.0, 0.0, 2.0), 0.5, effect="remove")
FLOOR = Sphere((0.0, 0.0, 0.0), 0.9)
"""Marks on the ball, of which the second takes its top away."""
RED, WHITE, BLUE = (0.8, 0.15, 0.1), (0.85, 0.85, 0.8), (0.2, 0.3, 0.6)


def gaussians(means, scales, colours, opacity=0.95):
    """Gaussians along the axes; `scales` (3,) or (N, 3), `colours` (3,) or (N, 3), `opacity` a number or (N,)."""
    means = np.asarray(means, np.float32).reshape(-1, 3)
    n = len(means)
    return Gaussians(
        means,
        np.log(np.broadcast_to(scales, (n, 3))).astype(np.float32),
        np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        logit(np.broadcast_to(opacity, (n,)).astype(np.float64)).astype(np.float32),
        ((np.broadcast_to(colours, (n, 3)) - 0.5) / SH_C0).astype(np.float32),
        np.zeros((n, 3, 0), np.float32),
    )


def ball_on_floor(seed=0, n_ball=700, floor_side=30, n_floaters=12):
    """The scene, rows in random order, and which of them are the ball, (N,). The floaters lie 15 to 30 radii away."""
    rng = np.random.default_rng(seed)
    outward = rng.normal(size=(n_ball, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    grid = (np.arange(floor_side) + 0.5) / floor_side * 6 - 3
    floor = np.stack(np.meshgrid(grid, grid, [-0.05], indexing="ij"), -1).reshape(-1, 3)
    floor[:, :2] += rng.uniform(-0.03, 0.03, (len(floor), 2))
    checks = np.where((np.floor(floor[:, 0]) + np.floor(floor[:, 1]))[:, None] % 2 == 0, WHITE, BLUE)
    away = rng.normal(size=(n_floaters, 3))
    away *= rng.uniform(15, 30, (n_floaters, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    n = n_ball + len(floor) + n_floaters
    colours = np.concatenate([np.tile(RED, (n_ball, 1)), checks, np.tile(WHITE, (n_floaters, 1))])
    scales = np.full((n, 3), 0.08)
    scales[n_ball:] = 0.11, 0.11, 0.02
    means = np.concatenate([CENTRE + RADIUS * outward, floor, away])
    scene = gaussians(means, scales, colours + rng.normal(0, 0.02, (n, 3)))
    order = rng.permutation(n)
    return scene.select(order), order < n_ball


def two_balls(shift=(2.4, 0, 0)):
    """A red ball at the origin of the floor and a blue one beside it; which Gaussians are the first and the second."""
    scene, truth = ball_on_floor()
    second = scene.select(truth)
    second = second.replace(means=second.means + np.float32(shift), sh_dc=second.sh_dc[:, ::-1].copy())
    rows = np.arange(len(scene) + len(second))
    return concatenate([scene, second]), np.pad(truth, (0, len(second))), rows >= len(scene)


def camera_at(position, target=CENTRE, size=200):
    """A camera that looks at the ball, or elsewhere."""
    pose = look_at(np.asarray(position, float), np.asarray(target, float), UP)
    return Camera(pose, intrinsics(np.radians(60), size, size), size, size)


def save_cameras(path, cameras, names=None):
    """Write cameras as a `cameras.json` of upright pictures 0.png, 1.png, ... or of other names."""
    frames = [
        {
            "file": name,
            "width": camera.width,
            "height": camera.height,
            "K": camera.K.tolist(),
            "world_to_camera": camera.world_to_camera.tolist(),
        }
        for name, camera in zip(names or map("{}.png".format, range(len(cameras))), cameras, strict=True)
    ]
    path.write_text(json.dumps({"up": UP.tolist(), "frames": frames}))


def dilated(scene, truth, reach=0.5):
    """The ball and whatever lies within `reach` of its surface."""
    return truth | (np.linalg.norm(scene.means - CENTRE, axis=1) < RADIUS + reach)


def eroded(scene, truth, depth=0.3):
    """The ball without a cap of that depth at its side."""
    return truth & (scene.means[:, 0] < RADIUS - depth)


def with_floaters(scene, truth):
    """The ball and all that floats far from it."""
    return truth | (np.linalg.norm(scene.means, axis=1) > 10)


def moved(scene, rotation, scale=1.0, shift=(0, 0, 0)):
    """The scene after x -> scale rotation x + shift; only for colours of SH degree 0."""
    return scene.replace(
        means=(scale * scene.means @ rotation.T + shift).astype(np.float32),
        log_scales=scene.log_scales + np.float32(np.log(scale)),
        quaternions=quaternions_of(rotation @ rotation_matrices(scene.quaternions)),
    )


def any_rotation(seed=0):
    """A rotation (3, 3) about no axis in particular."""
    return rotation_matrices(np.random.default_rng(seed).normal(size=(1, 4)).astype(np.float32))[0]


def jaccard(a, b):
    """Intersection over union of two selections."""
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def small_config(**stages):
    """Views of 160 pixels, the true up vector, and no Gaussian that the scene does not have: rows can be compared."""
    usual = {"up": (0.0, 0.0, 1.0), "plan": PlanConfig(size=160), "refine": "off", "background": "clean"}
    return TrimConfig(**{**usual, **stages})


@contextmanager
def one_thread():
    """Kernels on so few pixels spend most of their time waiting for each other's threads."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def accepted_view(camera, mask):
    """An accepted view of which only camera and mask are used."""
    blank = np.zeros(mask.shape, np.float32)
    black = Rendering(np.zeros((*mask.shape, 3), np.float32), blank, blank)
    return TrimmedView(View(camera, black, blank, blank, blank, bounding_box(mask)), mask, None)


def empty(view):
    """A mask of nothing."""
    return np.zeros(view.alpha.shape, np.bool_)


def opposite(view):
    """A mask of all but the object."""
    return ~view.silhouette


def tight(view):
    """A mask a little smaller than the object, so that its rim lies across the contour."""
    return cv2.erode(view.silhouette.astype(np.uint8), np.ones((5, 5))) > 0


def trim_by(draw, scene, selection, **given):
    """A trim by masks that a function draws in the views which it would look from."""
    views, _ = views_to_segment(scene, selection, **given)
    return trim(scene, selection, masks=[(view.camera, draw(view)) for view in views] or None, **given)


def object_rows(result):
    """Which rows of the scene the object has, whole or in part, (N,)."""
    rows = np.zeros(len(result.scene), np.bool_)
    rows[result.objects[0].source_index] = True
    return rows


def with_object(result, **changes):
    """A result of one object with other values in fields of that."""
    return replace(result, objects=(replace(result.objects[0], **changes),))


def check_parts(result, selection):
    """Every row of the scene is in the object, in the background, split into both, or discarded; labels tell why."""
    part, rest, why_rest = result.objects[0], result.background_source, result.background_label
    mine, why_mine = part.source_index, part.label
    assert len(mine) == len(why_mine) == len(result.object)
    assert len(rest) == len(why_rest) == len(result.background)
    whole = np.concatenate([mine[why_mine != RowLabel.SPLIT_INSIDE], rest[why_rest != RowLabel.SPLIT_OUTSIDE]])
    split = mine[why_mine == RowLabel.SPLIT_INSIDE]
    every = np.concatenate([whole[whole >= 0], split, result.discarded])
    np.testing.assert_array_equal(np.sort(every), np.arange(len(result.scene)))
    np.testing.assert_array_equal(
        rest[why_rest == RowLabel.SPLIT_OUTSIDE], split[: np.count_nonzero(why_rest == RowLabel.SPLIT_OUTSIDE)]
    )
    assert set(why_mine) <= {RowLabel.KEPT, RowLabel.ADDED, RowLabel.SPLIT_INSIDE}
    made_up = {RowLabel.RELIT, RowLabel.FILLED}
    assert set(why_rest) <= {RowLabel.KEPT, RowLabel.REMOVED, RowLabel.SPLIT_OUTSIDE} | made_up
    np.testing.assert_array_equal(rest < 0, why_rest == RowLabel.FILLED)
    assert selection[mine[why_mine == RowLabel.KEPT]].all()
    assert not selection[mine[why_mine == RowLabel.ADDED]].any()
    assert selection[rest[why_rest == RowLabel.REMOVED]].all()
    assert not selection[rest[why_rest == RowLabel.KEPT]].any()
    for part, rows, why in ((result.object, mine, why_mine), (result.background, rest, why_rest)):
        untouched = why < RowLabel.SPLIT_INSIDE
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc"):
            np.testing.assert_array_equal(getattr(part, name)[untouched], getattr(result.scene, name)[rows[untouched]])
        same = why < RowLabel.FILLED
        np.testing.assert_array_equal(part.sh_dc[same], result.scene.sh_dc[rows[same]])
