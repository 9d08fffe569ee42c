"""The fit of an object's boundary to soft coverage: what it mends, what it leaves alone, and what it never does."""

from __future__ import annotations

import numpy as np
import pytest

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.gaussians import Gaussians, concatenate, rotation_matrices
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.rendering.tile_renderer import draw
from gaussian_trimmer.trimming.alpha_targets import ObjectRenders, OutlineViews, coverage_targets, resized_mask
from gaussian_trimmer.trimming.fitting import Target, fit
from gaussian_trimmer.trimming.refinement import Pieces, RefineConfig
from gaussian_trimmer.trimming.refinement import refine as refine_pieces
from gaussian_trimmer.views.camera_rings import Lens, ring

_BOUNDS = Bounds(axes=np.eye(3), centre=np.zeros(3), half_extents=np.ones(3))
_CONFIG = RefineConfig(steps=24)


def _sphere(n: int, radius: float, scale: float, colour: float, seed: int = 0) -> Gaussians:
    """Opaque flat Gaussians on a sphere."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return Gaussians(
        points, np.full((n, 3), np.log(scale)), np.tile([1.0, 0, 0, 0], (n, 1)), np.full(n, 3.0),
        np.full((n, 3), colour), np.zeros((n, 3, 0)),
    )  # fmt: skip


def _views(size: int = 96) -> list[Camera]:
    return small_views_around(_BOUNDS, 4, (10.0, 45.0), size)


def small_views_around(bounds: Bounds, count: int, pitches_degrees: tuple[float, ...], size: int) -> list[Camera]:
    """Views from the full circle at several heights, each turned by half a step from the last."""
    places = [(2 * np.pi * (np.arange(count) + i / 2) / count, np.radians(p)) for i, p in enumerate(pitches_degrees)]
    lens = Lens(size, np.radians(60), 0.01 * bounds.radius)
    return [camera for place in places for camera in ring(bounds.centre, bounds.axes, 4.2, *place, lens)]


def _true_masks(cameras: list[Camera]) -> list[np.ndarray]:
    """Coverage by a ball of radius 0.8, four times oversampled."""
    masks = []
    for camera in cameras:
        large = camera.resized(4.0)
        y, x = np.mgrid[: large.height, : large.width]
        rays = large.ray_directions(np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        along = rays @ -large.centre
        inside = (large.centre @ large.centre - along**2 < 0.8**2).reshape(large.height, large.width)
        masks.append(resized_mask(inside, camera))
    return masks


def _rendered(inner: Gaussians, background: Gaussians, camera: Camera) -> ObjectRenders:
    return OutlineViews([camera], None, 1.0).render(inner, background, colours=True)


def _error(ball: Gaussians, cameras: list[Camera], masks: list[np.ndarray]) -> float:
    pairs = zip(cameras, masks, strict=True)
    return float(np.mean([np.abs(draw(ball, [camera]).alpha[0] - mask).mean() for camera, mask in pairs]))


def refine(
    ball: Gaussians, background: Gaussians, views: OutlineViews, config: RefineConfig
) -> tuple[Pieces, str | None]:
    """Fit Gaussians of a scene that has nothing else."""
    renders = views.render(ball, background, colours=True)
    return refine_pieces(Pieces.of(ball, np.arange(len(ball))), renders, config)


def _elongation(gaussians: Gaussians) -> np.ndarray:
    return np.asarray(np.ptp(gaussians.log_scales, axis=1))


def test_a_ball_that_sticks_out_of_its_masks_is_fitted_to_them_from_other_views_too() -> None:
    ball = _sphere(150, 0.8, 0.15, 0.5)
    nothing, cameras = ball.select(slice(0, 0)), _views()
    refined, _ = refine(ball, nothing, OutlineViews(cameras, _true_masks(cameras), 1.0), _CONFIG)
    others = small_views_around(_BOUNDS, 3, (30.0,), 96)
    masks = _true_masks(others)
    assert _error(refined.gaussians, others, masks) < 0.4 * _error(ball, others, masks)


def test_what_shows_no_wrong_pixel_is_left_as_it_was() -> None:
    ball, core = _sphere(150, 0.8, 0.15, 0.5), _sphere(30, 0.2, 0.05, 0.2, seed=1)
    whole, cameras = concatenate([ball, core]), _views()
    refined, _ = refine(whole, ball.select(slice(0, 0)), OutlineViews(cameras, _true_masks(cameras), 1.0), _CONFIG)
    untouched = np.flatnonzero(~refined.fitted)
    assert set(refined.source[untouched]) >= set(range(150, 180))
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc"):
        before, after = getattr(whole, name)[refined.source[untouched]], getattr(refined.gaussians, name)[untouched]
        np.testing.assert_array_equal(after, before)
    np.testing.assert_array_equal(refined.gaussians.sh_rest, whole.sh_rest[refined.source])


def test_parts_come_last_and_every_gaussian_of_the_object_is_still_there() -> None:
    ball, cameras = _sphere(40, 0.8, 0.3, 0.5), _views()
    refined, _ = refine(ball, ball.select(slice(0, 0)), OutlineViews(cameras, _true_masks(cameras), 1.0), _CONFIG)
    assert refined.part.any() and np.all(np.diff(refined.part.astype(int)) >= 0)
    assert set(refined.source) == set(range(40))
    np.testing.assert_array_equal(refined.part, np.bincount(refined.source)[refined.source] > 1)


def test_no_gaussian_becomes_a_needle_or_flies_away() -> None:
    ball, cameras = _sphere(60, 0.8, 0.2, 0.5), _views()
    config = RefineConfig(cut_above=1e6)
    masks = [np.zeros_like(mask) for mask in _true_masks(cameras)]  # Nothing can satisfy these.
    refined, _ = refine(ball, ball.select(slice(0, 0)), OutlineViews(cameras, masks, 1.0), config)
    assert (_elongation(refined.gaussians) < np.log(5.0)).all()
    moved = np.linalg.norm(refined.gaussians.means - ball.means[refined.source], axis=1)
    assert (moved <= 2.0 * np.sqrt(3) * 0.2 + 1e-5).all()


def test_degenerate_gaussians_stay_numbers() -> None:
    ball, cameras = _sphere(60, 0.8, 0.2, 0.5), _views(64)
    scales, logits, quaternions = ball.log_scales.copy(), ball.opacity_logits.copy(), ball.quaternions.copy()
    scales[0], scales[1, 2], scales[2, 0], logits[3], logits[4] = -60, -np.inf, 5, np.inf, -np.inf
    quaternions[5] *= 1e-6
    odd = ball.replace(log_scales=scales, opacity_logits=logits, quaternions=quaternions)
    refined, _ = refine(
        odd, ball.select(slice(0, 0)), OutlineViews(cameras, _true_masks(cameras), 1.0), RefineConfig(steps=6)
    )
    for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc"):
        assert not np.isnan(getattr(refined.gaussians, name)).any()


def test_what_something_nearer_hides_says_nothing_about_coverage() -> None:
    ball, camera = _sphere(150, 0.8, 0.15, 0.5), _views()[0]
    screen = _sphere(1, 1e-9, 0.4, 0.9)
    screen = screen.replace(means=(screen.means + 0.5 * camera.centre).astype(np.float32))
    (target,) = coverage_targets(_rendered(ball, screen, camera))
    (alone,) = coverage_targets(_rendered(ball, screen.select(slice(0, 0)), camera))
    middle = camera.height // 2, camera.width // 2
    assert target.weight[3][middle] == 0 and alone.weight[3][middle] == 1
    assert alone.picture[3][middle] == 1 and alone.picture[3, 0, 0] == 0


@pytest.mark.parametrize(("screen_opacity", "stays"), [(0.3, True), (0.95, False)])
def test_the_outline_stays_where_the_scene_shows_half_of_the_object(screen_opacity: float, stays: bool) -> None:
    ball, camera = _sphere(150, 0.6, 0.15, 0.5), _views()[0]
    screen = _sphere(1, 1e-9, 2.0, 0.9)  # before all of the object, and as wide as the view
    screen = screen.replace(
        means=(screen.means + 0.5 * camera.centre).astype(np.float32),
        opacity_logits=np.float32([np.log(screen_opacity / (1 - screen_opacity))]),
    )
    render = _rendered(ball, screen, camera)
    alone, target = render.alone.alpha[0], coverage_targets(render)[0].picture[3]
    silhouette, outline = alone > 0.5, (alone > 0.01) & (alone < 0.99)
    assert np.count_nonzero(outline & silhouette) > 50
    if stays:
        np.testing.assert_allclose(target, np.clip(2 * alone - 0.5, 0, 1), atol=1e-6)
    else:
        assert (target[silhouette] < 0.5).all()


def test_a_fit_turns_a_gaussian_towards_what_it_should_show() -> None:
    long = Gaussians(
        np.zeros((1, 3)), np.log([[0.5, 0.1, 0.1]]), [[1.0, 0, 0, 0]], [2.0], np.zeros((1, 3)), np.zeros((1, 3, 0))
    )
    angle = 0.4
    turned = long.replace(quaternions=np.array([[np.cos(angle / 2), 0, 0, np.sin(angle / 2)]], np.float32))
    cameras = small_views_around(_BOUNDS, 4, (40.0, 70.0), 64)
    weight = np.ones((4, 64, 64), np.float32)
    targets = [Target(camera, draw(turned, [camera]).images[0], weight) for camera in cameras]
    fitted = fit(long, np.array([True]), targets, 60, 0.05)
    axis = rotation_matrices(fitted.quaternions)[0, :, 0]
    assert abs(axis @ [np.cos(angle), np.sin(angle), 0]) > np.cos(0.1)
    assert fit(long, np.array([False]), targets, 5, 0.05) is long


def test_thin_things_are_not_fitted_to_what_labels_show_of_them() -> None:
    cameras = small_views_around(_BOUNDS, 4, (20.0, 50.0), 64)
    heights = np.linspace(-0.7, 0.7, 60)
    wire = Gaussians(
        np.column_stack([0.1 * np.sin(9 * heights), np.zeros(60), heights]), np.full((60, 3), np.log(0.02)),
        np.tile([1.0, 0, 0, 0], (60, 1)), np.full(60, 4.0), np.zeros((60, 3)), np.zeros((60, 3, 0)),
    )  # fmt: skip
    haze = _sphere(40, 0.6, 0.2, 0.4)
    left, reason = refine(wire, haze, OutlineViews(cameras, None, 1.0), _CONFIG)
    assert reason is not None and "three pixels" in reason and not left.fitted.any() and left.gaussians is wire
    fitted, reason = refine(wire, haze, OutlineViews(cameras, None, 1.0), RefineConfig(steps=2, max_thin=1))
    assert reason is None and fitted.fitted.any()


@pytest.mark.parametrize("n", [0, 1])
def test_objects_of_hardly_any_gaussian_are_no_problem(n: int) -> None:
    few, cameras = _sphere(n, 0.5, 0.2, 0.5), _views(32)
    refined, _ = refine(few, few.select(slice(0, 0)), OutlineViews(cameras, None, 1.0), RefineConfig(steps=2))
    assert set(refined.source) == set(range(n))
