"""Captures that are walked through: storey, tiles, what tiles agree on, and a furnished room below its ceiling."""

from dataclasses import replace
from types import SimpleNamespace

import made_room as room
import numpy as np
import pytest
import toy

from gaussian_trimmer.cameras import Viewpoint
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding import find
from gaussian_trimmer.finding.found import FoundObject
from gaussian_trimmer.finding.tiles import Candidate, TallThings, choose_objects, plan_tiles
from gaussian_trimmer.gaussians import concatenate, mask_of_rows
from gaussian_trimmer.geometry.storey import Storey, find_storey, tile_sides
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selecting import interpretation
from gaussian_trimmer.selecting.marks import Click, Grow, Marks
from gaussian_trimmer.surface.overview import OverviewConfig, plan_views
from gaussian_trimmer.trimming.up_vector import up_from_layers
from gaussian_trimmer.views.standing import seen_shares, stands_in_rooms

UP = np.array([0.0, 0.0, 1.0])


def ceiling(height, side=6.0):
    return room.sheet((-side / 2, -side / 2, height), (side, 0, 0), (0, side, 0), room.GREY, 91)


def furniture():
    return room.box((-1, -1), (0.9, 0.9, 0.8), room.RED, 1), room.box((1, 1), (0.6, 0.6, 0.5), room.BLUE, 5)


def test_floor_and_ceiling_are_the_layers_that_cover_most():
    storey = find_storey(concatenate([room.floor(), ceiling(2.6), *furniture()]), UP)
    assert storey.floor == pytest.approx(0, abs=0.03)
    assert storey.ceiling == pytest.approx(2.6, abs=0.03)
    assert storey.head_height == pytest.approx(1.3, abs=0.03)
    open_above = find_storey(concatenate([room.floor(), *furniture()]), UP)
    assert open_above.ceiling is None and open_above.head_height == np.inf  # nothing is cut


def test_a_person_stands_in_a_room_between_floor_and_ceiling_and_nowhere_outdoors():
    inside = concatenate([room.floor(), ceiling(2.6), *furniture()])
    [(eye, target)] = stands_in_rooms(inside, UP)
    storey, ways = find_storey(inside, UP), inside.means[:, :2]
    assert storey.floor < eye[2] < storey.ceiling and target[2] < eye[2]
    assert (ways.min(axis=0) < eye[:2]).all() and (eye[:2] < ways.max(axis=0)).all()
    assert stands_in_rooms(toy.ball_on_floor()[0], UP) == []


def test_nobody_stands_in_a_cupboard_or_looks_at_what_is_before_the_eyes():
    sides = np.linspace(0.9, 0.3, 60)
    cupboard = [room.box((1.5, 1.5), (side, side, 2.4), room.RED, seed) for seed, side in enumerate(sides)]
    inside = concatenate([room.floor(), ceiling(2.6), *furniture(), *cupboard])
    looks = stands_in_rooms(inside, UP, 16)
    assert looks
    for eye, target in looks:
        camera = toy.camera_at(eye, target, 96)
        _, near, far = seen_shares(inside, camera, 1.3)
        assert near < 1.5 * far
        assert np.abs(eye[:2] - 1.5).max() > 0.45


def test_views_to_click_in_are_those_of_a_person_in_rooms_and_together_show_all_furniture():
    scene, part = room.scene_of(room.floor(), ceiling(2.6), *furniture())
    views = plan_views(scene, UP, OverviewConfig(ring=3)).views
    assert 1 < len(views) <= 6
    shown = sum(render(scene, view.camera, weights=True).weights for view in views)
    for number in (2, 3):
        assert (shown[part == number] > 0).mean() > 0.5
    assert all(0 < view.camera.centre[2] < 2.6 for view in views)
    aimed = plan_views(scene, UP, OverviewConfig(target=(1.0, 1.0, 0.2)))
    assert aimed.views[0].drawn_centre == (1.0, 1.0, 0.2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_up_is_found_in_a_room_between_its_floor_and_ceiling(axis, sign):
    """Turned by whole axes: the floor is the end that the furniture is near."""
    scene = concatenate([room.floor(), ceiling(2.6), *furniture()])
    to_axes = sign * np.roll(np.eye(3), axis - 2, axis=0)  # up becomes this axis
    turned = toy.moved(scene, to_axes if np.linalg.det(to_axes) > 0 else to_axes @ np.diag([-1.0, 1, 1]))
    found = up_from_layers(turned)
    assert found.direction == pytest.approx(sign * np.eye(3)[axis])
    assert found.source == "floor"


def test_a_cloud_has_no_floor():
    rng = np.random.default_rng(0)
    flakes = toy.gaussians(rng.normal(size=(5000, 3)), (0.05, 0.05, 0.005), room.GREY)
    assert up_from_layers(flakes.replace(quaternions=rng.normal(size=(5000, 4)).astype(np.float32))) is None


def test_tiles_overlap_by_a_third():
    plan = np.random.default_rng(0).uniform(0, 10, (20_000, 2))
    tiles = list(plan_tiles(plan, 4.5))
    counts = np.bincount(np.concatenate([tile.rows for tile in tiles]), minlength=len(plan))
    assert set(counts.tolist()) == {1, 2, 4}
    assert counts.mean() == pytest.approx(2.25, rel=0.1)
    for tile in tiles:
        assert (plan[tile.rows] >= tile.low - 1e-9).all()
        assert (plan[tile.rows] <= tile.low + tile.side + 1e-9).all()


def test_a_box_at_the_border_of_a_tile_is_not_whole():
    tile = next(plan_tiles(np.random.default_rng(0).uniform(0, 10, (5000, 2)), 6.0))
    middle = tile.low + tile.side / 2
    assert tile.holds(middle - 0.1, middle + 0.1)
    assert not tile.holds(tile.low, middle)


def candidate(rows, confidence=0.8, reaches_ceiling=False, foot=0.0, doubts=()):
    centre = np.array([0, 0, foot + 0.5])
    thing = FoundObject(1, 0.1, 1.0, 0, centre, np.ones(3), confidence, "stands on a surface", doubts)
    return Candidate(np.array(rows), thing, reaches_ceiling, reaches_ceiling)


def test_what_most_tiles_agree_on_wins_and_what_one_tile_joined_is_dropped():
    chair, other = range(100), range(100, 180)
    both = range(180)
    found = choose_objects([candidate(chair)] * 5 + [candidate(other)] * 4 + [candidate(both)] * 2, 200, UP)
    assert [len(one.rows) for one in found] == [100, 80]
    assert choose_objects([candidate(chair)], 200, UP) == choose_objects([], 200, UP) == []  # one tile is none
    assert all(one.thing.confidence == 0.8 for one in found)


def test_things_that_are_sure_by_themselves_come_before_the_group_that_most_tiles_made_of_them():
    table, chairs = range(600), [range(600, 700), range(700, 800)]
    alone = [candidate(chair) for chair in chairs for _ in range(3)]
    found = choose_objects([candidate(range(800))] * 9 + alone, 800, UP)
    assert [one.rows.tolist() for one in found] == [list(chairs[0]), list(chairs[1]), list(table)]
    assert [len(one.rows) for one in choose_objects([candidate(range(800))] * 9 + alone[:3], 800, UP)] == [800]


def test_what_stands_on_a_thing_is_a_part_of_it_however_many_tiles_agree_on_it():
    sofa = [candidate(range(400))] * 3
    cushions = [candidate(range(first, first + 60), foot=0.4) for first in (0, 100) for _ in range(9)]
    assert [len(one.rows) for one in choose_objects(sofa + cushions, 400, UP)] == [400]
    assert [len(one.rows) for one in choose_objects(cushions, 400, UP)] == [60, 60]
    assert [len(one.rows) for one in choose_objects(sofa + cushions, 400, UP, parts=True)] == [60, 60, 280]


def test_on_wide_ground_each_square_has_a_view_and_its_things_are_large_in_it():
    flat = np.stack(np.meshgrid(*[np.linspace(-10, 10, 120)] * 2), -1).reshape(-1, 2)
    ground = toy.gaussians(np.column_stack([flat, np.zeros(len(flat))]), (0.12, 0.12, 0.005), room.GREY)
    things = [room.box((x, y), (0.4, 0.4, 1.0), room.RED) for x in (-7.0, 0.0, 7.0) for y in (-7.0, 7.0)]
    scene = concatenate([ground, *things])
    planned = plan_views(scene, UP)
    near, whole = planned.views[: planned.whole.start], planned.views[planned.whole.start :]
    assert len(whole) == 8 < len(near)
    for thing in things:
        sizes = [[], []]
        for of, views in zip(sizes, (near, whole), strict=True):
            for view in views:
                pixels, depths = view.camera.project(thing.means.mean(axis=0, keepdims=True))
                of += [view.camera.K[0, 0] / depths[0]] if view.camera.contains(pixels)[0] else []
        assert max(sizes[0]) > 2 * max(sizes[1])
    assert all(render(scene, view.camera).alpha.mean() > 0.5 for view in near)


@pytest.mark.parametrize("times", [1, 4])
def test_how_wide_the_ground_is_tells_whether_a_place_is_looked_at_in_tiles_and_not_how_many_gaussians_it_has(times):
    tall = room.box((0, 0), (0.4, 0.4, 1.0), room.RED)
    for width, expected in ((3.0, 0), (12.0, 3), (400.0, 0)):
        flat = np.stack(np.meshgrid(*[np.linspace(-width / 2, width / 2, 120)] * 2), -1).reshape(-1, 2)
        ground = toy.gaussians(np.column_stack([flat, np.zeros(len(flat))]), (0.05, 0.05, 0.005), room.GREY)
        scene = concatenate([ground, tall] * times)
        sides = tile_sides(find_storey(scene, UP), scene.means @ UP)
        assert len(sides) == expected


def test_what_few_tiles_found_alike_is_small_or_cut_off_is_doubted():
    few, small, cut = (
        [candidate(range(100))] * 2,
        [candidate(range(100, 110))] * 4,
        [candidate(range(120, 200), 0.8, True)] * 4,
    )
    found = choose_objects(few + small + cut, 200, UP)
    assert len(found) == 3
    assert max(one.thing.confidence for one in found) < 0.5
    assert {one.thing.why.split(", ")[1].split()[0] for one in found} == {"outlined", "small", "reaches"}


def test_a_sure_object_has_no_doubts_and_an_unsure_one_has_each_once():
    seen_badly = candidate(range(100), 0.3, doubts=("seen in few views",))
    [sure] = choose_objects([seen_badly, candidate(range(100)), candidate(range(100))], 100, UP)
    assert sure.thing.sure and sure.thing.why == "stands on a surface"
    [small] = choose_objects([candidate(range(10), 0.3, doubts=("small",))] * 3, 100, UP)
    assert small.thing.why == "stands on a surface, small"
    [doubted] = choose_objects([candidate(range(100)), seen_badly, seen_badly], 100, UP)
    assert not doubted.thing.sure and doubted.thing.why.count(",") == 1


def test_how_sure_an_object_is_is_what_most_that_are_alike_think():
    looks = [candidate(range(100), confidence) for confidence in (0.9, 0.3, 0.2)]
    assert [one.thing.confidence for one in choose_objects(looks, 100, UP)] == [0.3]


def tall_room():
    """A wall, a shelf in front of it, and a lamp whose shade is wider than its post: parts 0 to 2."""
    shade = room.ball((1.5, 1.5), 0.35, room.RED)
    shade = shade.replace(means=shade.means + np.array([0, 0, 1.5], np.float32))
    lamp = concatenate([room.box((1.5, 1.5), (0.1, 0.1, 1.6), room.GREY), shade])
    return room.scene_of(room.wall(6.0, 2.6), room.box((-2.5, 0), (0.4, 1, 2.0), room.RED), lamp)


def test_a_wall_reaches_the_ceiling_and_a_tall_thing_gets_its_upper_part_back():
    scene, part = tall_room()
    tall = TallThings(scene, UP, Storey(0.0, 2.6, 16.0, 1.0, True), 1.3)
    below = scene.means[:, 2] < 1.3
    reach = [tall.reaches_ceiling(np.flatnonzero(below & (part == number))) for number in range(3)]
    assert reach == [True, False, False]
    assert tall.grown(np.where(below, part, 0), [1, 2]).tolist() == part.tolist()


def test_a_click_takes_a_tall_thing_with_its_upper_part():
    lamp = room.box((1, 1), (0.3, 0.3, 1.9), room.BLUE)
    scene, part = room.scene_of(room.floor(), ceiling(2.6), *furniture()[:1], lamp)
    middle = np.array([1, 0.85, 0.4])
    seen = (np.linalg.norm(scene.means - middle, axis=1) < 0.1).astype(np.float32)
    [thing, *_] = find.ThingsAtPoints(scene, UP).at(middle, seen)
    assert toy.jaccard(mask_of_rows(thing, len(scene)), part == 3) > 0.8


def test_a_click_on_what_near_looks_show_in_part_looks_farther(monkeypatch):
    scene, part = room.scene_of(room.floor(), *furniture())
    monkeypatch.setattr(find, "tile_sides", lambda storey, heights: (4.0, 0.9, 0.7))  # no thing fits in a smaller one
    middle = scene.means[part == 1].mean(axis=0).astype(np.float64)
    seen = (np.linalg.norm(scene.means - middle, axis=1) < 0.6).astype(np.float32) * (part == 1)
    [thing, *_] = find.ThingsAtPoints(scene, UP).at(middle, seen)
    assert toy.jaccard(mask_of_rows(thing, len(scene)), part == 1) > 0.8


def test_furniture_is_found_below_its_ceiling(monkeypatch):
    scene, part = room.scene_of(room.floor(), ceiling(2.6), *furniture())
    monkeypatch.setattr(find, "tile_sides", lambda storey, heights: (6.0, 4.5))
    found = find.find_objects(scene, up=UP)
    sure = [one.id for one in found if one.sure]
    for number in (2, 3):
        assert max(toy.jaccard(found.mask(one), part == number) for one in sure) > 0.8
    assert not (found.labels[part == 1] > 0).any()  # the ceiling
    assert not found.looked_at[part == 1].any()


@pytest.fixture
def clicks(monkeypatch):
    """Clicks in a furnished room that counts as a large capture: the scene, its parts, and what understands them."""
    scene, part = room.scene_of(room.floor(), ceiling(2.6), *furniture())
    monkeypatch.setattr(find, "tile_sides", lambda storey, heights: (9.0, 6.0, 4.5))
    view = Viewpoint(toy.camera_at((1, -2.2, 1.8), (1, 1, 0.4), 240))
    return scene, part, interpretation.MarkInterpreter(scene, Marks((), (0.0, 0.0, 1.0))), Click(120, 120, view)


def test_a_click_in_a_large_capture_takes_what_the_finder_sees_there(clicks):
    scene, part, interpreter, click = clicks
    state = interpreter.apply(interpretation.Selection.nothing(len(scene)), click)
    assert toy.jaccard(state.mask, part == 3) > 0.8
    assert state.interpretations == (interpretation.INTERPRETATIONS["piece"],)


def test_where_the_finder_sees_nothing_a_click_takes_what_is_seen_alone_or_the_region_around(monkeypatch):
    """A balloon high above the furniture, and the bare floor."""
    balloon = room.ball((0, 0), 0.4, room.RED)
    balloon = balloon.replace(means=balloon.means + np.float32([0, 0, 3]))
    scene, part = room.scene_of(room.floor(), balloon, *furniture())
    monkeypatch.setattr(find, "tile_sides", lambda storey, heights: (9.0, 6.0, 4.5))
    interpreter = interpretation.MarkInterpreter(scene, Marks((), (0.0, 0.0, 1.0)))
    interpreter._things = SimpleNamespace(needed=True, at=lambda point, seen: [])

    def click(eye, target):
        mark = Click(120, 120, Viewpoint(toy.camera_at(eye, target, 240)))
        return interpreter.apply(interpretation.Selection.nothing(len(scene)), mark)

    above = click((0, -2.5, 1), (0, 0, 3.4))
    assert above.interpretations == (interpretation.INTERPRETATIONS["alone"],)
    assert toy.jaccard(above.mask, part == 1) > 0.95
    below = click((2, -5, 2), (1.5, -1.5, 0))
    assert below.interpretations == (interpretation.INTERPRETATIONS["around"],)
    assert (part[below.mask] == 0).all()
    assert (np.linalg.norm(scene.means[below.mask] - [1.5, -1.5, 0], axis=1) < 1).all()


def test_the_same_click_made_again_takes_the_other_sizes_in_turn(clicks):
    scene, part, interpreter, click = clicks
    upper = (part == 3) & (scene.means[:, 2] > 0.3)
    thing, larger, smaller = map(np.flatnonzero, (part == 3, part >= 2, upper))
    interpreter._things = SimpleNamespace(needed=True, at=lambda point, seen: [thing, larger, smaller])
    state = interpreter.apply(interpretation.Selection.nothing(len(scene)), click)
    for rows in (larger, smaller):
        state = interpreter.apply(state, click)
        assert np.flatnonzero(state.mask).tolist() == rows.tolist()
        assert state.interpretations[-1] == interpretation.INTERPRETATIONS["size"]
    with pytest.raises(InputError):
        interpreter.apply(state, click)


def test_other_sizes_are_forgotten_after_a_click_that_corrects_or_another_mark(clicks):
    scene, part, interpreter, click = clicks
    interpreter._things = SimpleNamespace(
        needed=True, at=lambda point, seen: [np.flatnonzero(part == 3), np.flatnonzero(part >= 2)]
    )
    state = interpreter.apply(interpretation.Selection.nothing(len(scene)), click)
    assert state.other_sizes
    for mark in (Grow(1.0), replace(click, effect="remove")):
        after = interpreter.apply(state, mark)
        assert not after.other_sizes
        interpreter._things = SimpleNamespace(needed=True, at=lambda point, seen: [])
    assert after.before_click is None
