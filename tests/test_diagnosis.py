"""Inputs that can be read and are wrong: each is told in one sentence, and nothing is trimmed."""

import csv

import numpy as np
import pytest
import toy
from command_line import SMALL, run, save_ball

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.selecting.marks import Sphere
from gaussian_trimmer.trimming.diagnosis import neighbour_agreement, selection_warning, up_warning
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.trimming.up_vector import UpVector, up_from_ground_plane

SCENE, TRUTH = toy.ball_on_floor()
CONFIG = toy.small_config()
SCATTERED = TRUTH[np.random.default_rng(3).permutation(len(TRUTH))]


def cameras_towards(target, train=True):
    K = intrinsics(0.8, 64, 64)
    poses = [look_at(np.array([x, -5.0, 2.0]), np.asarray(target, float), toy.UP) for x in (-1.0, 0.0, 1.0)]
    return CameraSet(tuple(Camera(pose, K, 64, 64) for pose in poses), None, (train,) * 3, False)


def far_away(scene, shift):
    return scene.replace(means=(scene.means.astype(np.float64) + shift).astype(np.float32))


def check_untrimmed(result, selection):
    assert result.objects[0].views == ()
    np.testing.assert_array_equal(result.object_mask, selection)
    toy.check_parts(result, selection)
    assert describe(result)["objects"][0]["views"] == []
    assert "\n" not in result.objects[0].refused


def test_a_selection_of_rows_in_another_order_is_known():
    result = trim(SCENE, SCATTERED, config=CONFIG)
    assert "scattered over the scene" in result.objects[0].refused
    check_untrimmed(result, SCATTERED)


def test_the_agreement_of_large_scenes_is_judged_on_a_sample():
    many = np.random.default_rng(0).uniform(-1, 1, (100_000, 3)).astype(np.float32)
    scene = toy.gaussians(many, 0.01, toy.RED)
    inside = np.linalg.norm(many, axis=1) < 0.4
    assert neighbour_agreement(scene, inside) > 0.7
    assert abs(neighbour_agreement(scene, np.random.default_rng(1).permutation(inside))) < 0.1


def test_training_cameras_that_do_not_see_the_object_are_known():
    result = trim(SCENE, TRUTH, config=CONFIG, cameras=cameras_towards((0, -9, 2)))
    assert "none of the 3 training cameras has the object" in result.objects[0].refused
    check_untrimmed(result, TRUTH)


def test_training_cameras_that_see_the_object_and_cameras_of_tests_are_taken():
    for cameras in (cameras_towards(toy.CENTRE), cameras_towards((0, -9, 2), train=False)):
        assert trim(SCENE, TRUTH, config=CONFIG, cameras=cameras).objects[0].refused is None


@pytest.mark.parametrize(
    ("selection", "warning"),
    [(~TRUTH, f"{100 * (~TRUTH).mean():.0f} % of the scene's Gaussians, and what it leaves out lies together"),
     (TRUTH | ~TRUTH, "whole file")],
)  # fmt: skip
def test_a_selection_of_most_of_the_scene_is_doubted(selection, warning):
    assert any(warning in text for text in trim(SCENE, selection, config=CONFIG).objects[0].warnings)
    assert trim(SCENE, TRUTH, config=CONFIG).objects[0].warnings == ()


def test_a_capture_of_little_but_the_object_is_not_doubted():
    scene, selection = SCENE, TRUTH | (np.linalg.norm(SCENE.means - toy.CENTRE, axis=1) < 1.5)
    some = selection | (np.arange(len(scene)) % 4 == 0)
    assert selection[some].mean() > 0.5
    assert selection_warning(scene.select(some), selection[some]) is None


def level_cameras(up):
    """Training cameras around the ball, held upright as if `up` were up."""
    frame = np.linalg.qr(np.column_stack([up, np.eye(3)[[1, 2]].T]))[0] * np.sign(np.sum(up))
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    places = toy.CENTRE + 4 * np.cos(angles)[:, None] * frame[:, 1] + 4 * np.sin(angles)[:, None] * frame[:, 2]
    K = intrinsics(0.8, 64, 64)
    return [Camera(look_at(place, np.asarray(toy.CENTRE, float), np.asarray(up, float)), K, 64, 64) for place in places]


@pytest.mark.parametrize("up", [(1, 0, 0), (0.2, 1, 0.5), (0.01, 0, -1)])
def test_up_of_cameras_that_the_ground_contradicts_is_doubted(up):
    config = toy.small_config(up=None)
    result = trim(SCENE, TRUTH, config=config, cameras=level_cameras(up))
    (warning,) = result.objects[0].warnings
    assert "(camera axes)" in warning
    assert trim(SCENE, TRUTH, config=config, cameras=level_cameras((0.01, 0, 1))).objects[0].warnings == ()
    assert "degrees away" in warning
    assert "--up 0.00 0.00 1.00" in warning
    assert describe(result)["objects"][0]["warnings"][0] == warning


def test_a_wall_behind_the_object_is_not_its_ground():
    floor = SCENE.select(~TRUTH & (SCENE.means[:, 2] < 0.1))
    walls = [
        toy.gaussians(floor.means[:, [0, 2, 1]] + np.float32([0, back, 2.0]), (0.11, 0.02, 0.11), toy.WHITE)
        for back in (1.1, 1.11, 1.12, 1.13)
    ]
    scene = concatenate([SCENE, *walls])
    selection = np.arange(len(scene)) < 0
    selection[: len(TRUTH)] = TRUTH
    ground = up_from_ground_plane(scene, selection)
    assert ground is not None
    assert abs(ground.direction[1]) > 0.9
    assert up_warning(scene, selection, UpVector(toy.UP, "camera axes", 1.0)) is None


@pytest.mark.parametrize("up", ["z", "x", None])
def test_an_up_vector_that_is_stated_or_found_is_not(up):
    config = toy.small_config(up=None)
    assert trim(SCENE, TRUTH, config=config, up=up).objects[0].warnings == ()


@pytest.mark.parametrize("away", [0.0, 10.0, 500.0])
def test_a_single_gaussian_is_not_an_object(away):
    selection = np.arange(len(SCENE)) == np.flatnonzero(TRUTH)[0]
    result = trim(SCENE.replace(means=SCENE.means + np.float32(away) * selection[:, None]), selection, config=CONFIG)
    assert "a single Gaussian" in result.objects[0].refused
    check_untrimmed(result, selection)


def test_coordinates_in_which_the_gaussians_are_lost_are_known():
    scene = far_away(SCENE, (431_200, 5_412_345, 120))
    result = trim(scene, TRUTH, config=CONFIG)
    assert "around 431200 5412345 121, where coordinates in single precision are 0.5 apart" in result.objects[0].refused
    check_untrimmed(result, TRUTH)
    for look in (gt.find_objects, lambda scene: gt.select(scene, [Sphere((431_200, 5_412_345, 121), 1)])):
        with pytest.raises(InputError, match="around 431200 5412345 "):
            look(scene)


def test_coordinates_of_a_map_that_still_resolve_the_gaussians_are_trimmed():
    selection = toy.dilated(SCENE, TRUTH)
    near = trim(SCENE, selection, config=CONFIG)
    far = trim(far_away(SCENE, (43_120, -12_345, 120)), selection, config=CONFIG)
    assert far.objects[0].refused is None
    assert toy.jaccard(far.object_mask, near.object_mask) > 0.97


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    save_ball(folder)
    np.save(folder / "scattered.npy", SCATTERED)
    return folder


@pytest.mark.parametrize(
    ("selection", "options", "said"),
    [
        ("scattered.npy", [], "scattered over the scene"),
        ("rough.npy", ["--set", "acceptance.max-wrong=0"], "0.0 is allowed"),
    ],
)
@pytest.mark.parametrize("quiet", [True, False])
def test_the_command_says_that_nothing_was_trimmed(ball, tmp_path, capsys, selection, options, said, quiet):
    command = ["trim", ball / "scene.ply", ball / selection, *options, "--output", tmp_path / "out", *SMALL]
    assert run(*command, *(["--quiet"] if quiet else [])) == 3
    printed = capsys.readouterr()
    assert bool(printed.out) != quiet
    assert printed.err.count("\n") == 1
    assert printed.err.startswith("gaussian-trimmer: Not trimmed. ")
    assert said.lower() in printed.err.lower()  # a clause in reports, a sentence here
    written = formats.read(tmp_path / "out" / "object.ply")
    assert len(written) == np.count_nonzero(np.load(ball / selection))
    assert (tmp_path / "out" / "before_after.png").exists()
    assert "no scene without it" in printed.err and not (tmp_path / "out" / "background.ply").exists()
    (row,) = csv.DictReader((tmp_path / "out" / "summary.csv").open(newline=""))
    assert row["state"] == "not trimmed" and said.lower() in row["message"].lower()
    assert quiet or "background: Not written, since nothing was trimmed." in printed.out
