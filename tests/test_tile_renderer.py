"""What drawing keeps and how much memory it takes; test_rendering_parity.py tests what it computes."""

import gc
from weakref import ref

import numpy as np
import pytest
from scenes import front_camera, gaussian, random_scene

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import blend_values, blend_weights, projection, render, tile_renderer, top_contributors
from gaussian_trimmer.rendering.projection import project_views
from gaussian_trimmer.rendering.tile_renderer import (
    ProjectionCache,
    draw,
    draw_projected,
    label_weights,
    portions,
    render_views,
)

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
    longest, listed = 0, projection.bin_gaussians

    def noted(splats, offset, picture, tiles, *args):
        nonlocal longest
        longest = max(longest, len(tiles.lists))
        listed(splats, offset, picture, tiles, *args)

    monkeypatch.setattr(projection, "bin_gaussians", noted)
    monkeypatch.setattr(projection, "_LISTED_BYTES", memory)
    for one, other in zip(whole, everything(), strict=True):
        np.testing.assert_array_equal(one, other)
    projected = project_views(SCENE, [CAMERA])
    assert projected.tiles is None
    assert longest <= max(memory / 6, np.diff(projected.tile_starts).max())


def large_and_faint(n):
    """Gaussians that reach every tile of the picture."""
    return concatenate([gaussian((0.4, -0.3, 0.2), scale=50.0, opacity=0.01)] * n)


def test_views_of_too_many_pairs_are_refused(monkeypatch):
    camera = front_camera(64, 32)
    monkeypatch.setattr(projection, "MOST_PAIRS", 80)
    render(large_and_faint(10), camera)
    with pytest.raises(InputError, match=r"64 x 32 pixels consists of 88 pairs .* at most 80 can be drawn; take sm"):
        render(large_and_faint(11), camera)


# --- several views at once

VIEWS = [front_camera(*size) for size in ((83, 61), (48, 32), (7, 5), (130, 17))]


@pytest.mark.parametrize("memory", [1, 1000, 1 << 29])
def test_several_views_are_what_each_of_them_is(memory, monkeypatch):
    monkeypatch.setattr(projection, "_LISTED_BYTES", memory)
    masks = [np.random.default_rng(0).random((camera.height, camera.width)) > 0.5 for camera in VIEWS]
    drawing = draw(SCENE, VIEWS, values=SCENE.means, images=[mask[None].astype(np.float32) for mask in masks])
    shown, found = list(render_views(SCENE, VIEWS, masks)), list(label_weights(SCENE, VIEWS, masks))
    for i, (camera, mask) in enumerate(zip(VIEWS, masks, strict=True)):
        seen, weights = render(SCENE, camera), blend_weights(SCENE, camera, mask.astype(np.uint8), 2)
        for picture in (drawing.renderings()[i], shown[i]):
            np.testing.assert_array_equal(picture.rgb, seen.rgb)
            np.testing.assert_array_equal(picture.depth, seen.depth)
            np.testing.assert_array_equal(picture.alpha, seen.alpha)
        np.testing.assert_array_equal(drawing.values[i].transpose(1, 2, 0), blend_values(SCENE, camera, SCENE.means))
        np.testing.assert_array_equal(drawing.weights[i, :, 0], weights[:, 1])
        np.testing.assert_array_equal(shown[i].weights, weights)
        np.testing.assert_array_equal(found[i], weights)


def test_without_colours_the_rest_is_the_same():
    plain, coloured = draw(SCENE, VIEWS, colours=False), draw(SCENE, VIEWS)
    assert len(plain.tiled) == 2
    np.testing.assert_array_equal(plain.tiled, coloured.tiled[3:])


def test_only_tiles_around_some_gaussians_are_drawn():
    around = np.arange(len(SCENE)) < 3
    partly, whole = draw(SCENE, VIEWS, around=around), draw(SCENE, VIEWS)
    reached = np.diff(project_views(SCENE.select(around), VIEWS).tile_starts) > 0
    assert 0 < reached.sum() < len(reached)
    np.testing.assert_array_equal(partly.tiled, whole.tiled * reached[None, :, None])


@pytest.mark.parametrize("memory", [1000, 1 << 29])
def test_a_part_of_what_was_projected_is_drawn_as_if_it_were_projected_alone(memory, monkeypatch):
    monkeypatch.setattr(projection, "_LISTED_BYTES", memory)
    part = np.arange(len(SCENE)) % 3 == 0
    whole, alone = project_views(SCENE, VIEWS), draw(SCENE.select(part), VIEWS)
    found = draw_projected(SCENE, whole.of(part))
    np.testing.assert_array_equal(found.tiled, alone.tiled)
    images = [np.ones((1, camera.height, camera.width), np.float32) for camera in VIEWS]
    np.testing.assert_array_equal(found.weigh(images)[:, part], alone.weigh(images))
    assert not found.weigh(images)[:, ~part].any()
    few = np.arange(len(SCENE)) < 3
    around = draw_projected(SCENE, whole.around(few))
    np.testing.assert_array_equal(around.tiled, draw(SCENE, VIEWS, around=few).tiled)


def test_no_view_shows_nothing():
    drawing = draw_projected(SCENE, project_views(SCENE, ()).of(np.arange(len(SCENE)) < 3), images=[])
    assert drawing.renderings() == [] and drawing.weights.shape == (0, len(SCENE), 0)


def test_views_are_drawn_in_portions_of_bounded_memory(monkeypatch):
    cameras = [CAMERA] * 7
    assert len(list(portions(SCENE, cameras))) == 1
    monkeypatch.setattr(tile_renderer, "_TOGETHER_BYTES", 160 * (len(SCENE) + CAMERA.width * CAMERA.height))
    assert [len(cameras[some]) for some in portions(SCENE, cameras)] == [2, 2, 2, 1]
    assert len(list(render_views(SCENE, cameras))) == 7
    monkeypatch.setattr(tile_renderer, "_TOGETHER_BYTES", 1)
    assert [len(cameras[some]) for some in portions(SCENE, cameras)] == [1] * 7
    assert not list(portions(SCENE, []))


def test_each_view_is_weighed_by_its_own_labels_in_portions_too(monkeypatch):
    rng = np.random.default_rng(0)
    labels = [rng.integers(0, 4, (camera.height, camera.width)).astype(np.uint8) for camera in VIEWS]
    whole = list(label_weights(SCENE, VIEWS, iter(labels), 4))
    for memory in (1, 160 * (len(SCENE) + CAMERA.width * CAMERA.height)):
        monkeypatch.setattr(tile_renderer, "_TOGETHER_BYTES", memory)
        np.testing.assert_array_equal(list(label_weights(SCENE, VIEWS, iter(labels), 4)), whole)


# --- memory for projections that are kept


@pytest.fixture
def cache(monkeypatch):
    """A cache that nothing else uses."""
    monkeypatch.setattr(tile_renderer, "_kept_projections", ProjectionCache())
    return tile_renderer._kept_projections


def projections_of(monkeypatch):
    """The cameras that are projected into from now on."""
    cameras, project = [], tile_renderer.project_views

    def noted(gaussians, asked):
        cameras.extend(asked)
        return project(gaussians, asked)

    monkeypatch.setattr(tile_renderer, "project_views", noted)
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
    size = project_views(SCENE, cameras[:1]).nbytes
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
