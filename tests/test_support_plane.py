"""A block with an arm on a table: where the table lies, and what stands in one piece with the block."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from toy import BLUE, RED, WHITE, gaussians

from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.support_plane import SupportPlaneConfig, find_support_plane, pieces_of_object
from gaussian_trimmer.trimming.label_crf import LabelCrfConfig, correct_labels

CONFIG = SupportPlaneConfig()
AXES = np.eye(3)
TABLE, BLOCK, ARM, POST, GROUND = range(5)


@dataclass(frozen=True, eq=False)
class Desk:
    """Gaussians in units of the object's radius, and what each is part of."""

    scene: Gaussians
    part: np.ndarray

    def of(self, *parts) -> BoolArray:
        return np.isin(self.part, parts)


def lattice(low, high, step=0.04):
    """Points that fill a box, (N, 3)."""
    axes = [np.arange(a, b + 1e-9, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def desk(height=-0.6, arm_colour=WHITE, step=0.04):
    """A red block on a white table, an arm at its side in the air, a red post apart from it."""
    table = lattice((-1.4, -1.4, height), (1.4, 1.4, height))
    table[:, 2] += np.random.default_rng(0).uniform(-0.01, 0.01, len(table))
    block = lattice((-0.3, -0.3, height + 0.04), (0.3, 0.3, height + 1.0), step)
    arm = lattice((0.34, -0.06, height + 0.5), (0.7, 0.06, height + 0.62), step)
    post = lattice((0.9, 0.6, height + 0.04), (1.0, 0.7, height + 0.8), step)
    parts = [table, block, arm, post]
    part = np.repeat(np.arange(4), [len(points) for points in parts])
    colours = np.array([WHITE, RED, arm_colour, RED])[part]
    return Desk(gaussians(np.concatenate(parts), (0.02,) * 3, colours), part)


def bounds(radius=1.0, centre=(0, 0, 0), axes=AXES):
    half = radius * np.array([0.6, 0.5, np.sqrt(1 - 0.61)])
    return Bounds(radius * np.array(centre, np.float64), axes, half)


def weights(thing):
    return np.full(len(thing.part), 5.0)


def support(thing, selection, box=None, seen=None, **config):
    seen = weights(thing) if seen is None else seen
    return find_support_plane(thing.scene.means, selection, seen, box or bounds(), replace(CONFIG, **config))


def attached(thing, selection, gap=0.1, reach=0.1, **config):
    found, positions, settings = support(thing, selection), thing.scene.means, replace(CONFIG, **config)
    return pieces_of_object(positions, selection, weights(thing), found, gap, reach, settings)[0]


def test_a_piece_that_is_selected_as_a_whole_is_the_objects_own():
    thing = desk()
    block, left = thing.of(BLOCK) | thing.of(ARM), thing.scene.means[:, 0] < 0
    for selection, own in ((block, True), (block & left, False)):
        found = support(thing, selection)
        whole = pieces_of_object(thing.scene.means, selection, weights(thing), found, 0.1, 0.1, CONFIG)[1]
        np.testing.assert_array_equal(whole, own & selection & found.above)


def with_ends(thing):
    """The block, with the far end of the arm, and the arm between them."""
    arm, x = thing.of(ARM), thing.scene.means[:, 0]
    return thing.of(BLOCK) | (arm & (x > 0.6)), arm & (x < 0.6)


@pytest.mark.parametrize("height", [-0.8, -0.6, -0.37, 0.0])
def test_the_table_is_found_at_its_height(height):
    thing = desk(height)
    found = support(thing, thing.of(BLOCK))
    above, layer = thing.scene.means[:, 2] > height + 0.06, np.abs(thing.scene.means[:, 2] - height) < 0.04
    assert found.on_surface[thing.of(TABLE)].all()
    np.testing.assert_array_equal(found.on_surface[layer], True)
    np.testing.assert_array_equal(found.above[above], True)
    assert not (found.on_surface & found.above).any()
    assert not found.above[thing.of(TABLE)].any()


@pytest.mark.parametrize("sunk", [-0.3, 0.3])
def test_the_table_is_found_where_the_selection_takes_some_of_it_or_leaves_out_the_foot(sunk):
    thing = desk()
    z = thing.scene.means[:, 2]
    near = np.abs(thing.scene.means[:, :2]).max(axis=1) < 0.5
    rough = thing.of(BLOCK) & (z > -0.6 + sunk) if sunk > 0 else thing.of(BLOCK) | (thing.of(TABLE) & near)
    assert support(thing, rough).on_surface[thing.of(TABLE)].all()


def test_there_is_none_in_a_cloud():
    thing = desk()
    cloud = thing.scene.means.copy()
    cloud[thing.of(TABLE)] = np.random.default_rng(1).uniform(-1.4, 1.4, (np.count_nonzero(thing.of(TABLE)), 3))
    assert support(replace(thing, scene=thing.scene.replace(means=cloud)), thing.of(BLOCK)) is None


@pytest.mark.parametrize("height", [-1.4, 1.0])
def test_a_layer_far_from_the_foot_is_none(height):
    thing = desk()
    means = thing.scene.means.copy()
    means[thing.of(TABLE), 2] += height + 0.6
    assert support(replace(thing, scene=thing.scene.replace(means=means)), thing.of(BLOCK)) is None


def test_a_wall_is_none():
    thing = desk()
    wall = thing.scene.means.copy()
    rows = thing.of(TABLE)
    wall[rows] = np.stack([np.full(rows.sum(), 0.9), wall[rows, 1], wall[rows, 0]], axis=1)
    assert support(replace(thing, scene=thing.scene.replace(means=wall)), thing.of(BLOCK)) is None


def on_a_plinth(level):
    """The desk's table cut to a plinth, with four times as many Gaussians `level` radii above or below it."""
    thing = desk()
    table = thing.of(TABLE) & (np.abs(thing.scene.means[:, :2]).max(axis=1) < 0.8)
    kept = np.flatnonzero(table | ~thing.of(TABLE))
    ground = np.repeat(np.flatnonzero(thing.of(TABLE)), 4)
    means = np.concatenate([thing.scene.means[kept], thing.scene.means[ground] + np.float32([0, 0, level])])
    part = np.concatenate([thing.part[kept], np.full(len(ground), GROUND)])
    return Desk(gaussians(means, (0.02,) * 3, WHITE), part)


@pytest.mark.parametrize("level", [-0.7, 1.5])
def test_the_top_of_a_plinth_is_found_though_most_lies_elsewhere(level):
    thing = on_a_plinth(level)
    box = (np.abs(thing.scene.means) < [0.5, 0.5, 0.7]).all(axis=1)
    seen = np.where(thing.of(GROUND), 1.0, 5.0)
    found = support(thing, box, seen=seen)
    assert found.plane.offset == pytest.approx(-0.6, abs=0.02)
    assert found.on_surface[thing.of(TABLE)].all()
    # The wisp that is left of it if hardly anything of it shows is no surface.
    assert support(thing, box, seen=np.where(thing.of(TABLE), 0.3, seen)) is None


def test_there_is_none_without_surroundings_without_a_selection_or_disabled():
    thing = desk()
    nothing = np.zeros(len(thing.part), np.bool_)
    assert support(thing, ~nothing) is None
    assert support(thing, nothing) is None
    assert support(thing, thing.of(BLOCK), seen=np.zeros(len(nothing))) is None
    assert support(thing, thing.of(BLOCK), enabled=False) is None
    assert support(thing, thing.of(BLOCK)) is not None


def test_an_arm_within_the_bounds_is_attached_and_a_piece_apart_is_not():
    thing = desk()
    ends, between = with_ends(thing)
    np.testing.assert_array_equal(attached(thing, ends), between)
    assert not attached(thing, thing.of(BLOCK), min_within_bounds=1.0).any()


def test_a_piece_within_the_bounds_of_a_few_selected_ends_is_attached_and_one_beyond_them_is_not():
    thing = desk()
    block = thing.of(BLOCK, ARM)
    positions = thing.scene.means
    low, high = positions[block].min(axis=0), positions[block].max(axis=0)
    ends = block & ((positions <= low + 0.15) | (positions >= high - 0.15)).any(axis=1)
    few = ends & (np.arange(len(ends)) % 3 == 0)
    assert weights(thing)[few].sum() < 0.5 * weights(thing)[block].sum()
    above = support(thing, few).above
    assert attached(thing, few)[block & ~few & above].all()
    left = few & (positions[:, 0] < np.median(positions[block, 0]))
    assert not attached(thing, left, gap=0.05, reach=0.05).any()


def test_a_selection_of_the_surface_itself_stands_on_nothing():
    thing = desk()
    part = thing.of(TABLE) & (thing.scene.means[:, 0] < 0)
    assert support(thing, part) is None
    assert support(thing, part | thing.of(BLOCK), max_selected_within=1.0) is not None


@pytest.mark.parametrize(("gap", "joined"), [(0.3, True), (0.1, False)])
def test_few_large_gaussians_are_one_piece_if_the_gap_is_as_wide_as_they_lie_apart(gap, joined):
    thing = desk(step=0.12)  # wider than the gap
    ends, between = with_ends(thing)
    found = attached(thing, ends, gap=gap)
    assert found[between].all() == joined
    assert not found[thing.of(POST)].any()


@pytest.mark.parametrize("enabled", [True, False])
def test_corrected_labels_take_a_missed_arm_whole_only_where_the_surface_is_known(enabled):
    thing = desk(arm_colour=RED)
    config = LabelCrfConfig(support_plane=SupportPlaneConfig(enabled=enabled))
    seen = weights(thing).astype(np.float32)
    corrected = correct_labels(thing.scene, thing.of(BLOCK), seen, bounds(), config) > 0.5
    assert corrected[thing.of(ARM)].all() == enabled
    assert corrected[thing.of(BLOCK)].mean() > 0.95
    assert not corrected[thing.of(TABLE, POST)].any()


def test_a_thing_against_the_object_is_left_out_of_a_selection_that_is_right():
    """Its colour, of which the object has spots and nothing else anything, speaks for it."""
    thing = desk(arm_colour=BLUE)
    selection = thing.of(BLOCK, POST)  # with the arm within its bounds
    assert attached(thing, selection, reach=0.12)[thing.of(ARM)].all()
    colours = thing.scene.sh_dc.copy()
    colours[np.flatnonzero(thing.of(BLOCK))[::20]] = colours[thing.of(ARM)][0]
    scene = thing.scene.replace(sh_dc=colours)
    seen = weights(thing).astype(np.float32)
    corrected = correct_labels(scene, selection, seen, bounds(), LabelCrfConfig()) > 0.5
    np.testing.assert_array_equal(corrected, selection)
