"""Scenes with which nothing can be computed are refused at once; all others are trimmed as their ordinary twins are."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.geometry.limits import check_magnitudes
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.rendering import tile_renderer
from gaussian_trimmer.trimming.trim import trim

SCENE, TRUTH = toy.ball_on_floor(n_ball=400, floor_side=20)
SELECTION = toy.dilated(SCENE, TRUTH)
CONFIG = toy.small_config()


@pytest.fixture
def no_drawing(monkeypatch):
    """Fails where a view of the scene is asked for."""
    monkeypatch.setattr(tile_renderer, "project_views", lambda *_: pytest.fail("Nothing is to be drawn."))


pytestmark = pytest.mark.usefixtures("one_thread")


def with_values(name, row, value):
    """The scene with another value in one row of an attribute."""
    values = getattr(SCENE, name).copy()
    values[row] = value
    return SCENE.replace(**{name: values})


def scaled(factor):
    """The scene in other units."""
    means = (SCENE.means * np.float64(factor)).astype(np.float32)
    return SCENE.replace(means=means, log_scales=(SCENE.log_scales + np.log(factor)).astype(np.float32))


@pytest.mark.parametrize(
    ("name", "value", "first"),
    [
        ("means", 1e19, r"1e\+19, 1e\+19, 1e\+19"),
        ("means", np.nan, "nan, nan, nan"),
        ("log_scales", 88.5, "88.5, 88.5, 88.5"),
        ("opacity_logits", np.nan, "nan"),
        ("quaternions", 0, "0, 0, 0, 0"),
        ("quaternions", [0, 1e20, 0, 0], r"0, 1e\+20, 0, 0"),
        ("sh_dc", -1e16, r"-1e\+16, -1e\+16, -1e\+16"),
    ],
)
def test_impossible_numbers_are_refused_before_any_work(no_drawing, name, value, first):
    with pytest.raises(InputError, match=rf"1 of 812 Gaussians have {name} .* row 5 \({first}\)"):
        trim(with_values(name, 5, value), SELECTION, config=CONFIG)


def test_ordinary_scenes_and_empty_ones_pass():
    check_magnitudes(SCENE)
    check_magnitudes(SCENE.select(slice(0, 0)))
    check_magnitudes(SCENE.select(slice(0, 1)))


@pytest.mark.parametrize(
    ("factor", "said"), [(1e30, "812 of 812 .* have means"), (1e-25, "whole scene is .* scale it up")]
)
def test_scenes_in_impossible_units_are_refused(no_drawing, factor, said):
    with pytest.raises(InputError, match=said):
        trim(scaled(factor), SELECTION, config=CONFIG)


@pytest.mark.parametrize("log_scale", [60.0, -1e6])
def test_objects_of_impossible_sizes_are_refused(no_drawing, log_scale):
    scene = SCENE.replace(log_scales=np.full_like(SCENE.log_scales, log_scale))
    if log_scale < 0:
        scene = scene.replace(means=np.where(TRUTH[:, None], np.float32(1), SCENE.means))
    with pytest.raises(InputError, match=r"The selected object is .* units large, .* select others, or scale the sc"):
        trim(scene, TRUTH, config=CONFIG)


@pytest.mark.parametrize("exponent", [-45, 45])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), None])
def test_units_do_not_matter(exponent, up):
    config = toy.small_config(up=up)
    expected = trim(SCENE, SELECTION, config=config)
    assert toy.jaccard(toy.object_rows(expected), TRUTH) > 0.98
    result = trim(scaled(2.0**exponent), SELECTION, config=config)
    np.testing.assert_array_equal(toy.object_rows(result), toy.object_rows(expected))


@pytest.mark.parametrize("offset", [1e4, 1e5])
def test_the_distance_from_the_origin_does_not_matter(offset):
    # As of maps: 1e5 metres to the east. Rounded there, then moved back, which is exact.
    far = SCENE.means + np.float32([offset, -2 * offset, offset / 10])
    near = (far.astype(np.float64) - [offset, -2 * offset, offset / 10]).astype(np.float32)
    results = [trim(SCENE.replace(means=means), SELECTION, config=CONFIG) for means in (far, near)]
    here, there = (toy.object_rows(result) for result in results)
    np.testing.assert_array_equal(here, there)
    assert toy.jaccard(here, TRUTH) > 0.98


@pytest.mark.parametrize(
    ("name", "value", "selected"),
    [
        ("means", 1e15, True), ("means", [0, -1e12, 0], False), ("log_scales", 80.0, True),
        ("log_scales", [80, -100, 0], False), ("log_scales", -3e38, True), ("quaternions", [2e-12, 0, 0, 0], True),
        ("quaternions", [0, 9e11, 0, 0], False), ("opacity_logits", np.inf, True), ("opacity_logits", -np.inf, True),
    ],
)  # fmt: skip
def test_one_extreme_gaussian_does_not_spoil_a_trim(name, value, selected, tmp_path):
    scene = with_values(name, np.flatnonzero(selected == SELECTION)[3], value)
    result = trim(scene, SELECTION, config=CONFIG)
    assert result.objects[0].refused is None
    toy.check_parts(result, SELECTION)
    assert toy.jaccard(toy.object_rows(result), TRUTH) > 0.98
    save(result, tmp_path / "trimmed")


@pytest.mark.parametrize(("distance", "size", "logit"), [(5e3, 0.1, 0.0), (1e7, 500.0, 5.0), (0.5, 300.0, 5.0)])
def test_neither_what_lies_kilometres_away_nor_a_veil_over_everything_spoils_a_trim(distance, size, logit):
    few = SCENE.select(np.flatnonzero(~TRUTH)[: 1 if distance < 1 else 5])
    away = few.means / np.linalg.norm(few.means, axis=1, keepdims=True) * np.float32(distance)
    few = few.replace(
        means=away, log_scales=np.full_like(away, np.log(size)), opacity_logits=np.full(len(few), logit, np.float32)
    )
    result = trim(concatenate([SCENE, few]), np.append(SELECTION, [False] * len(few)), config=CONFIG)
    rows = toy.object_rows(result)
    assert result.objects[0].refused is None and not rows[len(SCENE) :].any()
    assert toy.jaccard(rows[: len(SCENE)], TRUTH) > 0.97
