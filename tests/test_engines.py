"""Files for other programs stand upright there, look as before, and are in a format that the program reads."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import toy
from command_line import SMALL, run, save_ball
from scenes import front_camera, random_scene

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.commands.trim_run import scene_name
from gaussian_trimmer.formats import ply
from gaussian_trimmer.formats.torch_files import as_array, load
from gaussian_trimmer.gaussians import concatenate, rotation_matrices
from gaussian_trimmer.geometry.harmonics import turned
from gaussian_trimmer.output.engines import PlacingOptions, convex_hull, rotation_between
from gaussian_trimmer.rendering import render
from gaussian_trimmer.selection_files import load_objects
from gaussian_trimmer.selection_files.selection_file import SelectionOptions
from gaussian_trimmer.trimming.trim import trim_objects


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    save_ball(folder)
    return folder


def test_turned_gaussians_look_the_same_from_a_turned_camera():
    scene, camera, rotation = random_scene(0), front_camera(), toy.any_rotation(3)
    pose = camera.world_to_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ rotation.T
    before = render(scene, camera).rgb
    after = render(turned(scene, rotation), dataclasses.replace(camera, world_to_camera=pose)).rgb
    assert before.std() > 0.05
    np.testing.assert_allclose(after, before, atol=1e-4)


@pytest.mark.parametrize("target", [(0, 0, 1), (0, -1, 0), (0, 1, 0)])
def test_any_up_vector_is_turned_to_the_axis_that_is_wanted(target):
    for source in (*np.eye(3), *-np.eye(3), *(toy.any_rotation(seed)[0] for seed in range(5))):
        rotation = rotation_between(source, np.array(target, np.float64))
        np.testing.assert_allclose(rotation @ source, target, atol=1e-12)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)


def foot_of(gaussians, axis):
    """The point below the middle, at the lower end along an axis."""
    low, high = np.quantile(gaussians.means, [0.01, 0.99], axis=0)
    foot = (low + high) / 2
    foot[axis] = low[axis]
    return foot


def test_the_foot_is_at_the_origin_and_sizes_are_scaled_with_places():
    ball = toy.ball_on_floor(n_floaters=0)
    ball = ball[0].select(ball[1])
    moved = ball.replace(means=ball.means + np.float32([5, -3, 2]))
    place = PlacingOptions("blender", scale=100).placement(moved, "z")
    found = place.apply(moved)
    np.testing.assert_allclose(foot_of(found, 2), 0, atol=4)  # centimetres
    np.testing.assert_allclose(found.scales, 100 * moved.scales, rtol=1e-4)
    pose = np.array(place.as_json(moved)["file_to_scene"])
    np.testing.assert_allclose(found.means @ pose[:3, :3].T + pose[:3, 3], moved.means, atol=1e-5)
    box = place.as_json(moved)["box"]
    assert box["centre"][2] == pytest.approx(box["size"][2] / 2)
    centred = PlacingOptions(origin="centre").placement(moved, "z").apply(moved)
    np.testing.assert_allclose(centred.means.max(axis=0) + centred.means.min(axis=0), 0, atol=0.1)


@pytest.mark.parametrize("depth", [1, 0])  # a ball, and a disc
def test_a_hull_is_convex_closed_around_the_centres_and_faces_outwards(depth):
    scene, rows = toy.ball_on_floor(n_floaters=0)
    ball = scene.select(rows)
    ball = ball.replace(means=ball.means * np.float32([1, 1, depth]))
    corners, triangles = convex_hull(ball)
    a, b, c = corners[triangles].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    above = np.einsum("fk,fnk->fn", normals, corners[None] - a[:, None]) / np.linalg.norm(normals, axis=1)[:, None]
    assert above.max() < 1e-3 and len(corners) <= 128
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    if depth:
        assert np.einsum("fk,fk->f", a, np.cross(b, c)).sum() / 6 > 4  # a ball of radius 1 has 4.19


def test_trim_writes_both_parts_for_an_engine_beside_those_of_the_scene(ball, tmp_path, capsys):
    command = ["trim", ball / "scene.ply", ball / "rough.npy", "--up", "z", "--output", tmp_path / "out", *SMALL]
    assert run(*command, "--for", "three", "--origin", "scene") == 0
    assert "For three.js, upright: object_for_three.spz, background_for_three.spz" in capsys.readouterr().out
    own, theirs = (formats.read(tmp_path / "out" / f"object{name}") for name in (".ply", "_for_three.spz"))
    np.testing.assert_allclose(theirs.means, own.means @ rotation_between(*np.eye(3)[[2, 1]]).T, atol=1e-3)
    listed = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert {"object_for_three.spz", "poses.json"} <= set(json.dumps(listed).split('"'))
    assert run(*command, "--overwrite", "--config", tmp_path / "out" / "report.json") == 0
    again = formats.read(tmp_path / "out" / "object_for_three.spz")
    np.testing.assert_array_equal(again.means, theirs.means)
    assert run(*command, "--overwrite") == 0
    assert not (tmp_path / "out" / "object_for_three.spz").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--for", "unreal"), "For Unreal, upright if the up vector is right: object_for_unreal.ply; "),
        (("--origin", "foot"), "Placed: object_placed.ply; "),
    ],
)
def test_only_what_was_done_with_an_object_is_said(options, said, ball, tmp_path, capsys):
    scene, truth = toy.ball_on_floor()
    formats.write(scene.select(truth), tmp_path / "alone.ply")
    assert run("trim", tmp_path / "alone.ply", "--output", tmp_path / "out", *SMALL, *options) == 0
    assert f"{said}poses.json says where it lies.\n" in capsys.readouterr().out


def test_each_object_stands_at_the_origin_and_poses_say_where_in_the_scene(ball, tmp_path):
    np.save(tmp_path / "ids.npy", np.load(ball / "rough.npy").astype(np.int32) * 7)
    out = tmp_path / "out"
    command = ["trim", ball / "scene.ply", "--labels", tmp_path / "ids.npy", "--up", "z", "--output", out, *SMALL]
    assert run(*command, "--for", "unreal", "--format", "splat") == 0
    poses = json.loads((out / "poses.json").read_text())["files"]
    assert set(poses) == {"object_7_for_unreal.ply", "background_for_unreal.ply"}
    own, theirs = formats.read(out / "object_7.splat"), formats.read(out / "object_7_for_unreal.ply")
    pose = np.array(poses["object_7_for_unreal.ply"]["file_to_scene"])
    np.testing.assert_allclose(theirs.means @ pose[:3, :3].T + pose[:3, 3], own.means, atol=1e-5)
    assert abs(np.quantile(theirs.means[:, 1], 0.99)) < 0.05  # up is -y


@pytest.fixture(scope="module")
def two():
    """A trim of two balls, of which one has a name."""
    scene, first, second = toy.two_balls(np.float32([2.4, 0, 0]))
    return trim_objects(scene, {'a "red" ball': first, "7": second}, config=toy.small_config(), up="z")


def moved(points, matrix):
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def test_a_pose_is_the_matrix_and_can_be_taken_within_another_file(two):
    options = PlacingOptions("three", scale=2), PlacingOptions("unity", scale=3)
    first, second = (option.placement(part.gaussians, "z") for option, part in zip(options, two.objects, strict=True))
    points, pose = np.random.default_rng(0).normal(size=(5, 3)), first.pose()
    turn = rotation_matrices(np.float32([pose["quaternion"]]))[0]
    in_scene = moved(points, first.matrix())
    np.testing.assert_allclose(points @ turn.T * pose["scale"] + pose["translation"], in_scene, atol=1e-5)
    np.testing.assert_allclose(
        moved(moved(points, first.within(second).matrix()), second.matrix()), in_scene, atol=1e-5
    )


@pytest.mark.parametrize("options", [{}, {"origin": "foot", "scale": 10.0}])
def test_instances_are_in_one_file_with_their_ids_names_boxes_and_poses(options, two, tmp_path):
    assert PlacingOptions("instances", **options).write(two, tmp_path, ".spz") == ["instances.ply", "instances.json"]
    found, said = formats.read(tmp_path / "instances.ply"), json.loads((tmp_path / "instances.json").read_text())
    ids, scale = found.extras[said["column"]], options.get("scale", 1)
    assert ids.dtype == np.int32 and (ids == 0).sum() == len(two.background)
    for part, entry in zip(two.objects, said["instances"], strict=True):
        mine = found.select(ids == part.id)
        assert (entry["id"], entry["name"], entry["gaussians"]) == (part.id, part.name, len(mine))
        np.testing.assert_allclose(mine.scales, scale * part.gaussians.scales, rtol=1e-4)
        turn = rotation_matrices(np.float32([entry["quaternion"]]))[0]
        own = (mine.means - entry["translation"]) @ turn / entry["scale"]
        assert abs(np.quantile(own[:, 2], 0.01)) < 0.1 and np.abs(own.mean(axis=0)[:2]).max() < 0.1
        centre, size = (np.array(entry["box"][name]) for name in ("centre", "size"))
        assert size == pytest.approx([2, 2, 2], abs=0.3)
        assert (np.abs(own - centre) < size / 2 + 0.1).all()
    if not options:
        numbers = [part.id for part in two.objects]
        labels = load_objects(tmp_path / "instances.ply", found, numbers, SelectionOptions(property="instance_id"))
        np.testing.assert_array_equal(labels, ids)
        np.testing.assert_array_equal(found.means[ids == 2], two.objects[1].gaussians.means)
    assert PlacingOptions("instances").write(two, tmp_path, ".ply", background=False)
    assert (formats.read(tmp_path / "instances.ply").extras["instance_id"] > 0).all()


def test_gsplat_gets_the_rows_of_each_object_as_a_tensor(two, tmp_path):
    files = PlacingOptions("gsplat").write(two, tmp_path, ".ply")
    for part, file in zip(two.objects, files, strict=True):
        mask = as_array(load(tmp_path / file), load(tmp_path / file).value)
        assert mask.dtype == np.bool_
        np.testing.assert_array_equal(mask, two.labels == part.id)
        np.testing.assert_array_equal(gt.read_selection(tmp_path / file, two.scene), mask)
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    mask = torch.load(tmp_path / files[0], weights_only=True)
    assert torch.equal(mask, torch.from_numpy(two.labels == two.objects[0].id))


def test_a_stage_has_each_object_where_it_lies_with_its_label_and_collider(two, tmp_path):
    options = PlacingOptions("usd", scale=2.0)
    *files, stage_file = options.write(two, tmp_path, ".spz")
    assert stage_file == "scene.usda" and len(files) == 3
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom, UsdPhysics, UsdSemantics

    for file in files:  # what a converter makes of splats, but for their centres
        stage = Usd.Stage.CreateNew(str(tmp_path / f"{Path(file).stem}.usdc"))
        points = UsdGeom.Points.Define(stage, "/splats")
        points.GetPointsAttr().Set(formats.read(tmp_path / file).means)
        stage.SetDefaultPrim(points.GetPrim())
        stage.Save()
    stage = Usd.Stage.Open(str(tmp_path / stage_file))
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and stage.GetDefaultPrim().GetPath() == "/scene"
    background = UsdGeom.Points(stage.GetPrimAtPath("/scene/background")).GetPointsAttr().Get()
    assert len(background) == len(two.background)
    whole = options.placement(concatenate([part.gaussians for part in two.objects]), "z")
    for part in two.objects:
        prim = stage.GetPrimAtPath(f"/scene/object_{part.id}")
        assert UsdSemantics.LabelsAPI(prim, "class").GetLabelsAttr().Get() == [part.title]
        matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0)).T
        assert prim.GetChild("splats").GetTypeName() == "Points"  # the file's own
        splats = np.array(UsdGeom.Points(prim.GetChild("splats")).GetPointsAttr().Get())
        np.testing.assert_allclose(moved(splats, matrix), whole.apply(part.gaussians).means, atol=1e-4)
        mesh = UsdGeom.Mesh(prim.GetChild("collider"))
        corners, indices = np.array(mesh.GetPointsAttr().Get()), mesh.GetFaceVertexIndicesAttr().Get()
        assert UsdGeom.Mesh.ValidateTopology(indices, mesh.GetFaceVertexCountsAttr().Get(), len(corners))[0]
        assert (np.ptp(corners, axis=0) > 0.9 * np.ptp(splats, axis=0)).all()
        assert mesh.GetPrim().HasAPI(UsdPhysics.CollisionAPI)
        assert UsdPhysics.MeshCollisionAPI(mesh.GetPrim()).GetApproximationAttr().Get() == "convexHull"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("convert", "scene.ply", "b.ply", "--for", "instances"), "give it to trim"),
        (("trim", "scene.ply", "rough.npy", "--for", "gsplat", "--scale", "2"), "leave --origin and --scale out"),
    ],
)
def test_what_a_target_cannot_have_is_refused(command, said, ball, capsys, monkeypatch):
    monkeypatch.chdir(ball)
    assert run(*command) == 2 and said in capsys.readouterr().err
    assert not (ball / "b.ply").exists()


def test_convert_turns_for_an_engine_and_calls_nothing_upright_by_a_guess(ball, tmp_path, capsys):
    scene = formats.read(ball / "scene.ply")
    assert run("convert", ball / "scene.ply", tmp_path / "a.ply", "--for", "unreal", "--up", "z", "--scale", "2") == 0
    found = formats.read(tmp_path / "a.ply")
    shift = -found.means[:, 1] - 2 * scene.means[:, 2]
    np.testing.assert_allclose(shift, shift[0], atol=1e-4)
    formats.write(random_scene(0).select(np.arange(20)), tmp_path / "guess.ply")
    for source, target, said in (("a.ply", "b.sog", "unreal reads .ply"), ("guess.ply", "b.ply", "--up")):
        assert run("convert", tmp_path / source, tmp_path / target, "--for", "unreal") == 2
        assert said in capsys.readouterr().err and not (tmp_path / target).exists()
    assert run("convert", tmp_path / "guess.ply", tmp_path / "b.ply", "--scale", "2") == 0


@pytest.mark.parametrize(("target", "lost"), [("b.splat", "colour"), ("b.ply", "1 ")])
def test_what_a_format_does_not_keep_is_said(target, lost, tmp_path, capsys):
    scene = random_scene(0)
    scene = scene.replace(extras={"ripe": np.ones(len(scene), np.float32)}, sh_rest=np.ones((len(scene), 3, 15)))
    ply.write(scene, tmp_path / "a.ply", extras=True)
    assert run("convert", tmp_path / "a.ply", tmp_path / target) == 0
    assert lost in capsys.readouterr().out.split("Lost in")[1]
    assert run("convert", tmp_path / target, tmp_path / f"again{target[1:]}") == 0
    assert "Lost in" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("path", "name"),
    [("garden/scene.ply", "garden"), ("scene.ply", "scene"), ("out/cup/point_cloud/iteration_7/point_cloud.ply", "cup"),
     ("../splat.ply", "splat"), ("a/cup.compressed.ply", "cup"), ("flat/lod-meta.json", "flat")],
)  # fmt: skip
def test_a_scene_that_is_called_as_all_are_has_its_folders_name(path, name):
    assert scene_name(Path(path)) == name


@pytest.mark.parametrize(("name", "said"), [("a.compressed.ply", False), ("a.ply", True)])
def test_a_trim_says_what_its_format_rounds_anew(name, said, ball, tmp_path, capsys):
    formats.write(formats.read(ball / "scene.ply"), tmp_path / name)
    command = ["trim", tmp_path / name, ball / "rough.npy", "--up", "z", "--format", "compressed.ply", *SMALL]
    assert run(*command, "--output", tmp_path / "out") == 0
    assert ("precision" in capsys.readouterr().out) == said
