"""What drawing keeps and how much memory it takes; test_rendering_parity.py tests what it computes."""

import gc
from weakref import ref

import numpy as np
import pytest
from scenes import front_camera, gaussian, random_scene

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import blend_values, blend_weights, render, tile_renderer, top_contributors
from gaussian_trimmer.rendering.tile_renderer import ProjectionCache, project_view

SCENE, CAMERA = random_scene(0), front_camera()
LABELS = np.random.default_rng(0).integers(0, 4, (CAMERA.height, CAMERA.width)).astype(np.uint8)
PIXELS = np.random.default_rng(0).integers(0, (CAMERA.width, CAMERA.height), (80, 2))


def everything():
    """Whatever can be asked about a view."""
    seen = render(SCENE, CAMERA, weights=True)
    values = blend_values(SCENE, CAMERA, SCENE.means)
    weights = blend_weights(SCENE, CAMERA, LABELS, 4)
    return [
        seen.rgb, seen.alpha, seen.depth, seen.weights, values, weights,
        *top_contributors(SCENE, CAMERA, PIXELS, 5),
    ]  # fmt: skip


# --- memory for a view


@pytest.mark.parametrize("memory", [1, 100, 1000, 3000])
def test_a_view_in_parts_is_the_same_view(memory, monkeypatch):
    whole = everything()
    longest, listed = 0, tile_renderer.bin_gaussians

    def noted(splats, tiles, *args):
        nonlocal longest
        longest = max(longest, len(tiles.lists))
        listed(splats, tiles, *args)

    monkeypatch.setattr(tile_renderer, "bin_gaussians", noted)
    monkeypatch.setattr(tile_renderer, "_LISTED_BYTES", memory)
    for one, other in zip(whole, everything(), strict=True):
        np.testing.assert_array_equal(one, other)
    projection = project_view(SCENE, CAMERA)
    assert projection.tiles is None
    assert longest <= max(memory / 6, np.diff(projection.tile_starts).max())


def large_and_faint(n):
    """Gaussians that reach every tile of the picture."""
    return concatenate([gaussian((0.4, -0.3, 0.2), scale=50.0, opacity=0.01)] * n)


def test_views_of_too_many_pairs_are_refused(monkeypatch):
    camera = front_camera(64, 32)
    monkeypatch.setattr(tile_renderer, "MOST_PAIRS", 80)
    render(large_and_faint(10), camera)
    with pytest.raises(InputError, match=r"64 x 32 pixels consists of 88 pairs .* at most 80 can be drawn; take sm"):
        render(large_and_faint(11), camera)


# --- memory for projections that are kept


@pytest.fixture
def cache(monkeypatch):
    """A cache that nothing else uses."""
    monkeypatch.setattr(tile_renderer, "_kept_projections", ProjectionCache())
    return tile_renderer._kept_projections


def projections_of(monkeypatch):
    """The cameras that are projected into from now on."""
    cameras, project = [], tile_renderer.project_view

    def noted(gaussians, camera):
        cameras.append(camera)
        return project(gaussians, camera)

    monkeypatch.setattr(tile_renderer, "project_view", noted)
    return cameras


def test_a_view_is_projected_once(cache, monkeypatch):
    projected = projections_of(monkeypatch)
    for _ in range(2):
        render(SCENE, CAMERA)
        blend_weights(SCENE, CAMERA, LABELS, 4)
        top_contributors(SCENE, CAMERA, PIXELS, 5)
    assert projected == [CAMERA]


def test_projections_are_kept_by_their_bytes(cache, monkeypatch):
    cameras = [front_camera(20, 10) for _ in range(4)]
    size = project_view(SCENE, cameras[0]).nbytes
    assert size > 1000
    monkeypatch.setattr(tile_renderer, "_KEPT_BYTES", 3 * size)
    projected = projections_of(monkeypatch)
    for camera in [*cameras[:3], cameras[0], cameras[3]]:  # The oldest, the second one, makes room.
        render(SCENE, camera)
    assert projected == cameras
    render(SCENE, cameras[0])
    assert projected == cameras
    render(SCENE, cameras[1])
    assert projected == [*cameras, cameras[1]]
    assert sum(projection.nbytes for *_, projection in cache._kept.values()) <= 3 * size


def test_one_projection_is_kept_however_large_it_is(cache, monkeypatch):
    monkeypatch.setattr(tile_renderer, "_KEPT_BYTES", 1)
    projected = projections_of(monkeypatch)
    render(SCENE, CAMERA)
    render(SCENE, CAMERA)
    assert projected == [CAMERA]
    other = front_camera()
    render(SCENE, other)
    assert len(cache._kept) == 1


def test_no_scene_is_kept_alive(cache):
    scene = random_scene(3, 20)
    render(scene, CAMERA)
    watched = ref(scene)
    del scene
    gc.collect()
    assert watched() is None
    render(SCENE, CAMERA)
    assert len(cache._kept) == 1
