"""Files as people have them, after reports that they filed: each reads as what its maker meant, or is told why not."""

import json
import subprocess
import sys

import numpy as np
import pytest
import toy
from format_samples import sample
from fuzz.torch_archives import Raw, named, torch_file
from test_camera_files import random_cameras, write_colmap_binary

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.trimming.trim import trim, trim_objects
from gaussian_trimmer.trimming.up_vector import find_up

N = 60


def columns(gaussians):
    """Columns of a splat PLY by name, without normals."""
    parts = {"": gaussians.means, "f_dc_": gaussians.sh_dc, "f_rest_": gaussians.sh_rest.reshape(len(gaussians), -1)}
    parts |= {"opacity": gaussians.opacity_logits, "scale_": gaussians.log_scales, "rot_": gaussians.quaternions}
    found = {}
    for start, values in parts.items():
        for i, column in enumerate(values.T if values.ndim == 2 else [values]):
            found["xyz"[i] if not start else start + (str(i) if values.ndim == 2 else "")] = column
    return found


def write_ply(path, table, kind="float", comments=(), after=("", b"")):
    """Write columns as the vertices of a PLY, all of one kind."""
    types = {"float": "<f4", "double": "<f8", "ushort": "<f2"}
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {text}" for text in comments)]
    lines += [
        f"element vertex {len(table['x'])}",
        *(f"property {kind} {name}" for name in table),
        *after[0].split("\n"),
    ]
    path.write_bytes("\n".join([*filter(None, lines), "end_header\n"]).encode())
    with path.open("ab") as file:
        file.write(np.column_stack([*table.values()]).astype(types[kind]).tobytes() + after[1])
    return path


def assert_same(found, expected, atol=0.0):
    for name, column in columns(expected).items():
        np.testing.assert_allclose(columns(found)[name], column, rtol=1e-6, atol=atol, err_msg=name)


SPOILED = [("x", np.nan), ("scale_1", np.inf), ("f_dc_0", np.nan), ("opacity", np.nan), ("f_rest_3", -np.inf)]


@pytest.mark.parametrize(("name", "value"), [*SPOILED, ("all", 0)])
def test_rows_that_cannot_be_used_are_left_out_and_counted(tmp_path, name, value):
    gaussians, told = sample(N, 1), []
    table = {key: column.copy() for key, column in columns(gaussians).items()} | {"id": np.arange(N)}
    bad = np.isin(np.arange(N), [0, 1, 7, N - 1])
    for key in table if name == "all" else [name]:
        table[key][bad & (key != "id")] = value
    found = formats.read(write_ply(tmp_path / "a.ply", table), say=told.append)
    assert found.blank.tolist() == bad.tolist()
    assert_same(found.select(~bad), gaussians.select(~bad))
    assert found.extras["id"].tolist() == [*range(N)]
    assert np.isfinite(found.means).all()
    (sentence,) = told
    assert f"4 of {N} Gaussians have" in sentence
    assert "the first in row 0" in sentence
    assert (
        len(formats.convert(tmp_path / "a.ply", tmp_path / "b.ply")) == len(formats.read(tmp_path / "b.ply")) == N - 4
    )


def test_a_trim_leaves_unusable_rows_out_of_every_file(tmp_path):
    scene, ball = toy.ball_on_floor()
    table = {key: column.copy() for key, column in columns(scene).items()}
    bad = np.zeros(len(scene), bool)
    bad[::50] = True
    table["y"][bad] = np.nan
    read = formats.read(write_ply(tmp_path / "a.ply", table), say=lambda note: None)
    result = trim(read, ball, up=toy.UP)
    rows = np.concatenate([result.objects[0].source_index, result.background_source])
    assert not bad[rows[rows >= 0]].any()
    assert set(np.flatnonzero(bad)) <= set(result.discarded)
    only_usable = ~bad
    clean = trim(scene.select(only_usable), ball[only_usable], up=toy.UP)
    assert abs(int(result.object_mask.sum()) - int(clean.object_mask.sum())) <= 0.02 * ball.sum()
    with pytest.raises(InputError, match="nothing of it can be seen"):
        trim(read, bad)


def of_degree_4(path, gaussians):
    table = columns(gaussians)
    rest = np.zeros((len(gaussians), 3, 24), np.float32)
    rest[:, :, :15], rest[:, :, 15:] = gaussians.sh_rest, 0.5
    table = {name: column for name, column in table.items() if not name.startswith("f_rest")}
    write_ply(path, table | {f"f_rest_{i}": column for i, column in enumerate(rest.reshape(len(gaussians), -1).T)})


def from_cloudcompare(path, gaussians):
    names = {name: name if name in "xyz" else f"scalar_{name}" for name in columns(gaussians)}
    names |= {"opacity": "scal_opacity", "rot_0": "scalar_scal_rot_0"}
    write_ply(path, {names[name]: column for name, column in columns(gaussians).items()})


def with_more_elements(path, gaussians):
    after = "element extrinsic 2\nproperty float extrinsic\nelement color_space 1\nproperty uchar color_space"
    write_ply(path, columns(gaussians), after=(after, np.float32([1, 2]).tobytes() + b"\1"))


def with_crlf(path, gaussians):
    write_ply(path, columns(gaussians))
    header, _, rows = path.read_bytes().partition(b"end_header\n")
    path.write_bytes((header + b"end_header\n").replace(b"\n", b"\r\n") + rows)


@pytest.mark.parametrize(
    ("make", "atol", "told"),
    [
        (of_degree_4, 0, "of degree 4; what is above degree 3 is left out"),
        (from_cloudcompare, 0, ""),
        (with_more_elements, 0, ""),
        (with_crlf, 0, ""),
        (lambda path, g: write_ply(path, columns(g), "double"), 0, ""),
        (lambda path, g: write_ply(path, columns(g), "ushort"), 0.01, ""),
    ],
    ids=["sh4", "cloudcompare", "sharp", "crlf", "double", "ushort_half"],
)
def test_splat_plys_of_other_makers_are_read(tmp_path, make, atol, told):
    gaussians, said = sample(N, 3), []
    make(tmp_path / "a.ply", gaussians)
    assert_same(formats.read(tmp_path / "a.ply", say=said.append), gaussians, atol)
    assert [text for text in said if told not in text] == []
    assert bool(said) == bool(told)


def test_a_crop_by_cloudcompare_is_a_selection(tmp_path):
    gaussians, taken = sample(N, 1), np.arange(N) % 3 == 0
    from_cloudcompare(tmp_path / "crop.ply", gaussians.select(taken))
    assert load_selection(tmp_path / "crop.ply", gaussians).tolist() == taken.tolist()


def test_scales_and_opacities_that_are_none_of_logarithms_are_asked_about(tmp_path):
    gaussians = sample(N, 1)
    table = columns(gaussians) | {f"scale_{i}": gaussians.scales[:, i] for i in range(3)}
    table["opacity"] = gaussians.opacities
    write_ply(tmp_path / "a.ply", table)
    with pytest.raises(InputError, match="--values activated"):
        formats.read(tmp_path / "a.ply")
    assert_same(formats.read(tmp_path / "a.ply", values="activated"), gaussians, atol=2e-3)
    np.testing.assert_array_equal(formats.read(tmp_path / "a.ply", values="stored").log_scales, gaussians.scales)
    command = [sys.executable, "-m", "gaussian_trimmer", "convert", "a.ply", "b.ply", "--values", "activated"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert_same(formats.read(tmp_path / "b.ply"), gaussians, atol=2e-3)


def test_what_lost_its_digits_far_from_the_origin_is_said(tmp_path):
    table = columns(sample(N, 1))
    table = table | {"x": table["x"].astype(float) + 591000, "y": table["y"].astype(float) + 3341600}
    gaussians = formats.read(write_ply(tmp_path / "a.ply", table, "double"))
    assert "Coordinates have lost digits" in formats.losses(gaussians, ".ply", ".ply")
    assert not formats.losses(sample(N, 1), ".ply", ".ply")


@pytest.mark.parametrize(
    ("comment", "up"),
    [
        ("Vertical Axis: z", (0, 0, 1)),
        ("Vertical axis: 0 0 -1", (0, 0, -1)),
        ("Vertical axis: y", None),  # was Brush's constant
        ("Vertical axis: 0 0 nan", None),
        ("Vertical axis: 0 0 0", None),
    ],
)
def test_up_is_what_the_file_says_where_nothing_is_seen_of_it(tmp_path, comment, up):
    cloud = write_ply(tmp_path / "a.ply", columns(sample(N, 1)), comments=["Generated by nerfstudio", comment])
    found = find_up(formats.read(cloud))
    assert (found.source, tuple(found.direction)) == (("file format", up) if up else ("default", (0, -1, 0)))


@pytest.mark.parametrize("degree", [0, 3])
def test_a_checkpoint_of_gaussian_splatting_lightning(tmp_path, degree):
    gaussians, widths = sample(N, degree), np.full((N, 1), 0.01, np.float32)
    names = {"means": gaussians.means, "scales": gaussians.log_scales, "rotations": gaussians.quaternions}
    names |= {"shs_dc": gaussians.sh_dc[:, None], "shs_rest": gaussians.sh_rest.transpose(0, 2, 1)}
    names |= {"opacities": gaussians.opacity_logits[:, None]}
    state = {f"gaussian_model.gaussians.{name}": array for name, array in names.items()}
    model = Raw(named("internal.models.vanilla_gaussian", "VanillaGaussian") + b")\x81}X\1\0\0\0aK\1sb")
    value = {"epoch": 300, "state_dict": state, "hyper_parameters": {"gaussian": model}}
    folder = tmp_path / "run" / "checkpoints"
    folder.mkdir(parents=True)
    (folder / "epoch=300-step=30000.ckpt").write_bytes(torch_file(value))
    assert_same(formats.read(tmp_path / "run"), gaussians)
    state["gaussian_model.gaussians.filter_3d"] = widths
    (folder / "epoch=300-step=30000.ckpt").write_bytes(torch_file(value))
    told = []
    smooth = formats.read(tmp_path / "run", say=told.append)
    np.testing.assert_allclose(smooth.scales**2, gaussians.scales**2 + 1e-4, rtol=1e-4)
    ratio = np.prod(gaussians.scales / smooth.scales, axis=1, dtype=np.float64)
    np.testing.assert_allclose(smooth.opacities, gaussians.opacities * ratio, rtol=1e-3, atol=2e-7)
    assert "fused into scales and opacities" in told[-1]


def test_the_filter_of_mip_splatting_is_fused_and_leaves_selections_right(tmp_path):
    gaussians, taken = sample(N, 1), np.arange(N) % 3 == 0
    table = columns(gaussians) | {"filter_3D": np.full(N, 0.02)}
    scene = formats.read(write_ply(tmp_path / "a.ply", table), say=lambda note: None)
    assert not scene.extras
    assert (scene.log_scales > gaussians.log_scales).all()
    write_ply(tmp_path / "crop.ply", {name: column[taken] for name, column in table.items()})
    assert load_selection(tmp_path / "crop.ply", scene).tolist() == taken.tolist()


def test_several_objects_are_also_one_glb_with_a_node_each(tmp_path):
    scene, ball = toy.ball_on_floor()
    upper = ball & (scene.means[:, 2] > 1)
    result = trim_objects(scene, {"top": upper, "bottom": ball & ~upper}, up=toy.UP)
    folder = save(result, tmp_path / "out", format="glb")
    whole = formats.read(folder / "objects.glb", say=lambda note: None)
    np.testing.assert_allclose(
        whole.means, np.concatenate([part.gaussians.means for part in result.objects]), atol=1e-5
    )
    assert np.bincount(whole.extras["node"])[1:].tolist() == [len(part.gaussians) for part in result.objects]
    text = (folder / "objects.glb").read_bytes()
    assert b'"name":"top"' in text
    assert save(result, tmp_path / "out", format="glb", overwrite=True) == folder


@pytest.mark.parametrize(
    ("comments", "model"),
    [
        (["SplatRenderMode: mip"], "antialiased"),
        (["antialiased 1"], "antialiased"),
        (["antialiased 1", "SplatRenderMode: default"], "default"),
        (["SplatRenderMode: 2dgs"], "2dgs"),
        ([], "default"),
    ],
)
@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz", ".sog", ".splat", ".glb"])
def test_what_gaussians_were_trained_as_is_carried_or_said_to_be_lost(tmp_path, comments, model, suffix):
    scene = formats.read(write_ply(tmp_path / "a.ply", columns(sample(N, 1)), comments=comments))
    assert scene.model == scene.select(slice(3)).model == model
    formats.write_selected(scene, np.arange(N), scene.select(slice(2)), tmp_path / f"b{suffix}")
    lost = f"Gaussians are {model}" in formats.losses(scene, suffix, ".ply")
    assert lost == (suffix in {"antialiased": (".splat", ".glb"), "2dgs": (".splat", ".glb", ".spz")}.get(model, ()))
    assert formats.read(tmp_path / f"b{suffix}").model == ("default" if lost else model)


def test_surfels_without_a_third_scale_are_2dgs_and_are_written_so(tmp_path):
    gaussians = sample(N, 1)
    table = {name: column for name, column in columns(gaussians).items() if name != "scale_2"}
    scene = formats.read(write_ply(tmp_path / "a.ply", table))
    assert scene.model == "2dgs"
    np.testing.assert_allclose(scene.log_scales[:, :2], gaussians.log_scales[:, :2])
    assert (scene.scales[:, 2] < 0.01 * scene.scales[:, :2].min(axis=1)).all()
    formats.convert(tmp_path / "a.ply", tmp_path / "b.ply")
    assert b"SplatRenderMode: 2dgs" in (tmp_path / "b.ply").read_bytes()[:500]


def test_giants_far_away_move_neither_up_nor_the_cut(tmp_path):
    scene, ball = toy.ball_on_floor()
    giants = toy.gaussians([[0, 0, 500], [800, 0, 0]], (400.0,) * 3, toy.WHITE, 0.002)
    rough = np.pad(toy.dilated(scene, ball), (0, 2))
    before, after = (trim(each, rough[: len(each)], up=toy.UP) for each in (scene, concatenate([scene, giants])))
    same = before.object_mask == after.object_mask[: len(scene)]
    assert same.mean() > 0.999 and not after.object_mask[len(scene) :].any()


@pytest.mark.parametrize("kind", ["int", "float"])
def test_an_object_of_a_column_of_instances(tmp_path, kind):
    ids = np.where(np.arange(N) % 3 == 0, 3, np.where(np.arange(N) % 3 == 1, 7, 0)).astype(np.float32)
    table = columns(sample(N, 1)) | {"instance_id": ids if kind == "float" else ids.astype("<i4").view(np.float32)}
    write_ply(tmp_path / "a.ply", table)
    data = (tmp_path / "a.ply").read_bytes().replace(b"float instance_id", f"{kind} instance_id".encode())
    (tmp_path / "a.ply").write_bytes(data)
    options = SelectionOptions(property="instance_id", object_id=(7,))
    assert load_selection(tmp_path / "a.ply", sample(N, 1), options).tolist() == (ids == 7).tolist()


def test_rigs_and_frames_beside_the_images_of_colmap_change_nothing(tmp_path):
    cameras = random_cameras(3)
    write_colmap_binary(cameras, tmp_path)
    alone = read_camera_set(tmp_path)
    (tmp_path / "rigs.bin").write_bytes(bytes(32))
    (tmp_path / "frames.bin").write_bytes(bytes(32))
    (tmp_path / "points3D.bin").write_bytes(bytes(8))
    for one, other in zip(alone.cameras, read_camera_set(tmp_path).cameras, strict=True):
        assert one.name == other.name and (one.world_to_camera == other.world_to_camera).all()


def test_frames_of_a_transforms_json_with_lenses_of_their_own_and_paths_of_windows(tmp_path):
    one, other = {"fl_x": 500.0, "fl_y": 500.0, "cx": 32.0, "cy": 24.0}, {"fl_x": 600.0, "fl_y": 600.0}
    pose = {"transform_matrix": np.eye(4).tolist(), "w": 64, "h": 48}
    frames = [{**pose, **one, "k1": 0, "file_path": ".\\images\\a.png"}, {**pose, **one, **other, "file_path": "b.png"}]
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_model": "OPENCV", "frames": frames}))
    found = read_camera_set(tmp_path / "transforms.json").pinhole_cameras()
    assert [camera.K[0, 0] for camera in found] == [500, 600]
    assert [camera.name.replace("\\", "/").rpartition("/")[2] for camera in found] == ["a.png", "b.png"]
