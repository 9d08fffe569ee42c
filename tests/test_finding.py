"""Every object of a made room is found, the room is none, and names of rows, units and axes do not matter."""

import csv
import json
import shlex

import made_room as room
import numpy as np
import pytest
import toy
from command_line import run

import gaussian_trimmer as gt
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.finding.found import FindConfig
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.surface.regions import _certain_links, _merged, _mutual
from gaussian_trimmer.surface.room_surfaces import find_room
from gaussian_trimmer.surface.visible_surface import find_visible_surface, views_of
from gaussian_trimmer.trimming.up_vector import SURE_CONFIDENCE, UpVector

CAMERAS = room.cameras()


@pytest.fixture(scope="module")
def furnished():
    """Floor, wall, a red box, a blue ball that stands apart, and a green ball that leans against the box."""
    return room.scene_of(
        room.floor(),
        room.wall(),
        room.box((0, -0.9), (0.8, 0.8, 1.0), room.RED, 1),
        room.ball((0.3, 1.2), 0.5, room.BLUE, 2),
        room.ball((0.05, -0.14), 0.35, room.GREEN, 3),
    )


@pytest.fixture(scope="module")
def found(furnished):
    return find_objects(furnished[0], cameras=CAMERAS)


def best(found, mask):
    """The sure object that has most of some Gaussians (N,), and the Jaccard index of both."""
    sure = [one.id for one in found if one.sure]
    number = max(sure, key=lambda number: np.count_nonzero(found.mask(number) & mask))
    return number, toy.jaccard(found.mask(number), mask)


def test_what_stands_is_found_and_what_touches_is_told_apart(found, furnished):
    _, part = furnished
    assert sum(one.sure for one in found) == 3
    matched = [best(found, part == number) for number in (2, 3, 4)]
    assert len({number for number, _ in matched}) == 3
    assert min(overlap for _, overlap in matched) > 0.8


def test_nothing_is_sure_while_up_is_a_guess(furnished, found):
    up = UpVector(found.up.direction, "ground plane", 0.3)
    guessed = find_objects(furnished[0], cameras=CAMERAS, up=up)
    assert len(guessed) == len(found) and not any(one.sure for one in guessed)
    assert all(one.doubts[0] == "up is a guess" for one in guessed)


def test_the_room_is_no_object(found, furnished):
    _, part = furnished
    sure = np.isin(found.labels, [one.id for one in found if one.sure])
    assert np.mean(sure[part < 2]) < 0.02


def test_balls_of_two_colours_that_meet_in_a_long_concave_contact_are_two_things():
    balls = room.ball((0, -0.4), 0.5, room.RED, 1), room.ball((0, 0.35), 0.4, room.BLUE, 2)
    scene, part = room.scene_of(room.floor(), *balls)
    found = find_objects(scene, cameras=CAMERAS)
    matched = [best(found, part == number) for number in (1, 2)]
    assert len({number for number, _ in matched}) == 2
    assert min(overlap for _, overlap in matched) > 0.85


def test_a_box_of_one_colour_beside_its_like_is_one_thing():
    twins = [room.box((0, y), (0.8, 0.8, 0.6), room.RED, seed, 3) for seed, y in ((1, -0.4), (2, 0.4))]
    scene, part = room.scene_of(room.floor(), *twins)
    found = find_objects(scene, cameras=CAMERAS)
    assert sum(one.sure for one in found) == 1
    assert best(found, part > 0)[1] > 0.85


def test_the_lowest_strip_of_what_stands_may_belong_to_it_though_it_lies_in_the_layer_of_the_floor():
    up, sunk = np.array([0.0, 0.0, 1.0]), room.box((0, 0), (0.8, 0.8, 0.6), room.RED, 1)
    sunk = sunk.replace(means=sunk.means - np.float32([0, 0, 0.02]))
    scene, part = room.scene_of(room.floor(), sunk)
    surface = find_visible_surface(scene, views_of(scene, CAMERAS, up), up)
    found = find_room(surface)
    (floor,) = found.surfaces
    below = floor.own & (floor.heights < -floor.border) & (part[surface.rows] == 1)
    kept = below & found.border
    assert below.sum() > 20
    assert kept.sum() > 0.5 * below.sum()
    of_floor = (part[surface.rows] == 0) & floor.own & (floor.heights < -floor.border)
    assert found.border[of_floor].mean() < 0.02


@pytest.mark.parametrize("change", ["order", "scale", "rotation", "strays"])
def test_the_same_gaussians_give_the_same_objects(change, found, furnished):
    scene, _ = furnished
    rng = np.random.default_rng(5)
    order = rng.permutation(len(scene)) if change == "order" else np.arange(len(scene))
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0] if change == "rotation" else np.eye(3)
    turned *= np.sign(np.linalg.det(turned))
    scale = 37.0 if change == "scale" else 1.0
    other, cameras = room.moved(scene, CAMERAS, turned, scale, np.array([1.0, -2.0, 3.0]) * scale)
    strays = other.select(slice(5 if change == "strays" else 0))
    strays = strays.replace(means=1e4 * strays.means)
    again = find_objects(concatenate([other.select(order), strays]), cameras=cameras)
    assert sum(one.sure for one in again) == sum(one.sure for one in found)
    for one in found:
        if one.sure:
            assert best(again, np.append(found.mask(one.id)[order], np.zeros(len(strays), bool)))[1] > 0.97
            assert np.isclose(scale * one.size[2], again.objects[one.id - 1].size[2], rtol=0.1)


def test_surfaces_are_named_if_asked_and_objects_stay(found, furnished):
    scene, part = furnished
    named = find_objects(scene, cameras=CAMERAS, config=FindConfig(surfaces=True))
    surfaces = [one for one in named if one.kind == "surface"]
    for number in (0, 1):
        assert max(toy.jaccard(named.mask(one.id), part == number) for one in surfaces) > 0.9
    objects = [one.id for one in found]
    assert [one.id for one in named if one.kind == "object"] == objects
    assert all((named.mask(number) == found.mask(number)).mean() > 0.99 for number in objects)


def test_what_is_unsure_comes_last_and_says_why():
    pebble = room.ball((0.9, 0.6), 0.25, room.GREEN, 4)
    scene, part = room.scene_of(room.floor(), room.box((0, -0.9), (0.8, 0.8, 1.0), room.RED, 1), pebble)
    found = find_objects(scene, cameras=CAMERAS, config=FindConfig(min_shown=0.02))
    assert [one.sure for one in found] == sorted((one.sure for one in found), reverse=True)
    last = next(one for one in found if toy.jaccard(found.mask(one.id), part == 2) > 0.5)
    assert not last.sure and "small" in last.why
    assert last.id not in found.selections() and last.id in found.selections(unsure=True)


def test_a_thing_without_a_room_is_one_object():
    scene = room.box((0, 0), (0.8, 0.8, 1.0), room.RED, 1)
    found = find_objects(scene, up=(0, 0, 1))
    assert [one.sure for one in found] == [False] and "whole scene" in found.objects[0].why
    assert "1 unsure" in repr(found) and len(repr(found)) < 100
    assert found.mask(1).mean() > 0.95


def test_objects_are_merged_split_and_named(found, furnished):
    _, part = furnished
    numbers = [best(found, part == number)[0] for number in (2, 3, 4)]
    red, ball, green = numbers
    chosen = gt.chosen_objects(found, keep=numbers, merge=[(red, green)], names={ball: "ball"})
    assert set(chosen) == {str(red), "ball"}
    together = np.flatnonzero(found.mask(red) | found.mask(green))
    np.testing.assert_array_equal(chosen[str(red)], together)
    parts = gt.chosen_objects(found, keep=[red], merge=[(red, green)], split=[red])
    assert len(parts) > 1
    np.testing.assert_array_equal(np.sort(np.concatenate(list(parts.values()))), together)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"keep": [99]}, "no object 99"),
        ({"keep": []}, "No object is left"),
        ({"names": {1: "a", 2: "a"}}, "called 'a'"),
    ],
)
def test_wrong_choices_are_refused(found, wrong, words):
    with pytest.raises(InputError, match=words):
        gt.chosen_objects(found, **wrong)


def test_nothing_to_see_is_refused():
    with pytest.raises(InputError, match="Hardly anything shows"):
        find_objects(room.floor(0.3), cameras=CAMERAS)


def test_the_command_writes_labels_table_and_page_and_trims(furnished, tmp_path, capsys):
    room.save(furnished[0], CAMERAS, tmp_path)
    command = ["objects", tmp_path / "scene.ply", "--cameras", tmp_path / "cameras.json"]
    assert run(*command, "--output", tmp_path / "found", "--names", "1=first") == 0
    labels = np.load(tmp_path / "found" / "objects.npy")
    listed = json.loads((tmp_path / "found" / "objects.json").read_text())["objects"]
    assert labels.shape == (len(furnished[0]),) and labels.max() == len(listed)
    assert listed[0]["name"] == "first" and sum(one["sure"] for one in listed) == 3
    assert (tmp_path / "found" / "objects.csv").read_text().count("\n") == len(listed) + 1
    page = (tmp_path / "found" / "index.html").read_text()
    assert (tmp_path / "found" / "plan.png").is_file()
    assert all((tmp_path / "found" / f"object_{one['id']:03d}.png").is_file() for one in listed)
    assert page.count("<figure") == len(listed) and "--trim" in page
    assert "3 objects" in capsys.readouterr().out
    assert run(*command, "--output", tmp_path / "found", "--names", "1=first", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["objects"] == listed and {"batch.csv", "objects.npy"} <= set(printed["files"])
    (row,) = csv.DictReader((tmp_path / "found" / "batch.csv").open())
    sure = [str(one["id"]) for one in listed if one["sure"]]
    assert (row["name"], row["objects"], row["up"]) == ("found", " ".join(sure), "")  # the cameras tell it again
    trim = ["--output", tmp_path / "found", "--keep", 1, 3, "--trim", tmp_path / "trimmed"]
    assert run(*command, *trim, "--json", "--refine", "off", "--set", "plan.size=160", "--background", "exact") == 0
    assert {path.name for path in (tmp_path / "trimmed").glob("*.ply")} == {
        "object_1.ply", "object_3.ply", "background.ply",
    }  # fmt: skip
    assert json.loads(capsys.readouterr().out)["folder"] == str(tmp_path / "trimmed")


def test_a_command_that_finds_what_is_left_of_the_objects_is_printed(furnished, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    room.save(furnished[0], CAMERAS, tmp_path)
    quick = ["--views", 2, "--set", "plan.size=96", "--refine", "off"]
    assert run("objects", "scene.ply", "--cameras", "cameras.json", "--keep", 1, "--trim", "cut_out", *quick) == 0
    *_, line = capsys.readouterr().out.replace("\n", " ").split("To find what is left of them: ")
    program, *words = shlex.split(line)
    assert (program, words[:2]) == ("gaussian-trimmer", ["objects", "cut_out/background.ply"])
    assert run(*words, "--json") == 0
    left = json.loads(capsys.readouterr().out)["objects"]
    assert sum(one["sure"] for one in left) == 2


def test_an_up_vector_that_was_found_for_the_scene_is_that_of_its_trims(furnished, tmp_path):
    room.save(furnished[0], CAMERAS, tmp_path)
    quick = ["--views", 2, "--set", "plan.size=96", "--refine", "off", "--background", "exact", "--quiet"]
    find = ["objects", tmp_path / "scene.ply", "--output", tmp_path / "found", "--keep", 1, "--trim", tmp_path / "one"]
    assert run(*find, *quick) in (0, 3)
    found = json.loads((tmp_path / "found" / "objects.json").read_text())["up"]
    trimmed = json.loads((tmp_path / "one" / "report.json").read_text())["objects"][0]["up"]
    assert found["source"] == "ground plane" and found["confidence"] >= SURE_CONFIDENCE
    assert trimmed["direction"] == pytest.approx(found["direction"])
    (row,) = csv.DictReader((tmp_path / "found" / "batch.csv").open())
    *direction, confidence = [float(word) for word in row["up"].split()]
    assert direction == pytest.approx(found["direction"]) and confidence == pytest.approx(found["confidence"], abs=1e-3)
    command = json.loads((tmp_path / "one" / "report.json").read_text())["command"]
    assert run(*command, "--output", tmp_path / "again", "--quiet") in (0, 3)
    again = json.loads((tmp_path / "again" / "report.json").read_text())["objects"][0]["up"]
    assert again["source"] == "found before" and again["confidence"] == pytest.approx(confidence)
    assert again["direction"] == pytest.approx(found["direction"])


def test_a_batch_trims_what_was_found_in_several_scenes(furnished, tmp_path):
    lone, _ = room.scene_of(room.floor(), room.ball((0, 0.4), 0.5, room.BLUE, 2))
    bare, _ = room.scene_of(room.floor())
    for name, scene in (("a", furnished[0]), ("my room", lone), ("bare", bare)):
        (tmp_path / name).mkdir()
        room.save(scene, CAMERAS, tmp_path / name)
        options = ["--cameras", tmp_path / name / "cameras.json", "--output", tmp_path / "found" / name]
        assert run("objects", tmp_path / name / "scene.ply", *options, "--up", 0, 0, 1, "--quiet") == 0
    manifests = sorted((tmp_path / "found").glob("*/batch.csv"))
    assert [path.parent.name for path in manifests] == ["a", "my room"]  # nothing in the third
    quick = "--set plan.size=96 --views 2 --refine off --background exact --no-write-background"
    options = ["--output", tmp_path / "out", "--workers", 1, "--quiet"]
    assert run("batch", *manifests, *options, "--options", quick) == 0
    items = {path.parent.relative_to(tmp_path / "out" / "items").as_posix() for path in tmp_path.rglob("object.ply")}
    assert items == {"a/1", "a/2", "a/3", "my_room/1"}


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (["--keep", 1], "add --trim"),
        (["--names", "mug", "--trim", "x"], "'mug' names no object"),
        (["--merge", "3", "--trim", "x"], "'3' merges nothing"),
    ],
)
def test_wrong_options_are_refused(option, words, tmp_path, capsys):
    assert run("objects", tmp_path / "scene.ply", "--output", tmp_path / "found", *option) == 2
    assert words in capsys.readouterr().err


RNG = np.random.default_rng(0)
REGIONS = 40
PAIRS = np.unique(np.sort(RNG.integers(0, REGIONS, (300, 2)), axis=1), axis=0)
PAIRS = PAIRS[PAIRS[:, 0] < PAIRS[:, 1]]
LINKS, SIZES = RNG.random((len(PAIRS), 6)), RNG.random((REGIONS, 2))


def test_links_of_the_same_two_regions_are_summed_and_those_within_one_are_gone():
    numbers = RNG.permutation(np.arange(REGIONS) % 12)
    pairs, links, sizes = _merged(numbers, PAIRS, LINKS, SIZES)
    ends = np.sort(numbers[PAIRS], axis=1)
    across = ends[:, 0] != ends[:, 1]
    wanted, place = np.unique(ends[across], axis=0, return_inverse=True)
    order = np.lexsort(pairs.T[::-1])
    assert np.array_equal(pairs[order], wanted)
    sums = np.stack([np.bincount(place.ravel(), column) for column in LINKS[across].T], axis=1)
    assert np.allclose(links[order], sums)
    assert np.allclose(sizes, np.stack([np.bincount(numbers, column) for column in SIZES.T], axis=1))


def test_mutual_links_are_the_strongest_of_both_regions_and_not_zero():
    strength = np.where(RNG.random(len(PAIRS)) < 0.5, 0, RNG.random(len(PAIRS)))
    strongest = [strength[(region == PAIRS).any(axis=1)].max(initial=0) for region in range(REGIONS)]
    wanted = (strength > 0) & (strength == np.array(strongest)[PAIRS].max(axis=1))
    assert np.array_equal(_mutual(PAIRS, strength, REGIONS), wanted)


def test_links_are_certain_unless_both_regions_stand_by_themselves_or_they_are_weak():
    least, weakest = np.array([0.3, 0.3]), 0.4
    size = np.sqrt(SIZES[PAIRS, 0].min(axis=1))
    both = (least < SIZES).all(axis=1)[PAIRS].all(axis=1)
    wanted = np.where(~both & (LINKS[:, 0] >= weakest * size), LINKS[:, 0] / size, 0)
    assert 0 < np.count_nonzero(wanted) < len(PAIRS)
    assert np.allclose(_certain_links(PAIRS, LINKS, SIZES, least, weakest), wanted)
