"""Files for other programs stand upright there, look as before, and are in a format that the program reads."""

import dataclasses
import json

import numpy as np
import pytest
import toy
from command_line import SMALL, run, save_ball
from scenes import front_camera, random_scene

from gaussian_trimmer import formats
from gaussian_trimmer.output.engines import ENGINES, rotation_between, turned, upright
from gaussian_trimmer.rendering.reference import ReferenceRenderer


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    save_ball(folder)
    return folder


def test_turned_gaussians_look_the_same_from_a_turned_camera():
    scene, camera, rotation = random_scene(0), front_camera(), toy.any_rotation(3)
    pose = camera.world_to_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ rotation.T
    renderer = ReferenceRenderer()
    before = renderer.render(scene, camera).rgb
    after = renderer.render(turned(scene, rotation), dataclasses.replace(camera, world_to_camera=pose)).rgb
    assert before.std() > 0.05
    np.testing.assert_allclose(after, before, atol=1e-4)


@pytest.mark.parametrize("target", [(0, 0, 1), (0, -1, 0), (0, 1, 0)])
def test_any_up_vector_is_turned_to_the_axis_that_is_wanted(target):
    for source in (*np.eye(3), *-np.eye(3), *(toy.any_rotation(seed)[0] for seed in range(5))):
        rotation = rotation_between(source, np.array(target, np.float64))
        np.testing.assert_allclose(rotation @ source, target, atol=1e-12)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)


def test_what_stands_upright_already_is_not_touched():
    scene = random_scene(0)
    assert upright(scene, [0, 0, 1], "blender") is scene


@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_gets_files_that_can_be_written(name):
    assert set(ENGINES[name].reads) <= set(formats.FORMATS)


def test_trim_writes_both_parts_for_an_engine_beside_those_of_the_scene(ball, tmp_path, capsys):
    command = ["trim", ball / "scene.ply", ball / "rough.npy", "--up", "z", "--output", tmp_path / "out", *SMALL]
    assert run(*command, "--for", "three") == 0
    assert "For three.js, turned upright: object_for_three.spz and background_for_three.spz." in capsys.readouterr().out
    own, theirs = (formats.read(tmp_path / "out" / f"object{name}") for name in (".ply", "_for_three.spz"))
    np.testing.assert_allclose(theirs.means, own.means @ rotation_between(*np.eye(3)[[2, 1]]).T, atol=1e-3)
    assert len(formats.read(tmp_path / "out" / "background_for_three.spz")) == len(
        formats.read(tmp_path / "out" / "background.ply")
    )
    listed = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert "object_for_three.spz" in json.dumps(listed)
    assert run(*command, "--overwrite") == 0
    assert not (tmp_path / "out" / "object_for_three.spz").exists()


def test_convert_turns_for_an_engine(ball, tmp_path, capsys):
    scene = formats.read(ball / "scene.ply")
    assert run("convert", ball / "scene.ply", tmp_path / "a.ply", "--for", "unreal", "--up", "z") == 0
    found = formats.read(tmp_path / "a.ply")
    np.testing.assert_allclose(-found.means[:, 1], scene.means[:, 2], atol=1e-5)
    assert run("convert", ball / "scene.ply", tmp_path / "a.sog", "--for", "unreal") == 2
    assert "unreal reads .ply" in capsys.readouterr().err
