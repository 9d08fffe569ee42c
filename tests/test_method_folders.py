"""What segmentation methods leave in their folders: recognised by `info`, and taken by one command."""

from __future__ import annotations

import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
import toy
from command_line import SMALL, run
from dataset_layouts import save_capture
from fuzz.torch_archives import torch_file
from selection_builders import (
    checkpoint_entries,
    identity_columns,
    make_scene,
    rows_mask,
    save_ply,
    save_ply_like_sa3d_gs,
)

from gaussian_trimmer import formats
from gaussian_trimmer.commands.info import describe_file
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

N = 12
SCENE = make_scene(N)
IDS = [0, 1, 1, 2, 0, 1, 0, 0, 2, 0, 0, 0]
OBJECT = [1, 2, 5]


def save(path, value):
    """Save arrays, and what torch would save, as `.npy` or as torch does."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, value) if path.suffix == ".npy" else path.write_bytes(torch_file(value))


MASK, IDS_ARRAY = rows_mask(N, *OBJECT), np.array(IDS)
ITERATION = Path("point_cloud/iteration_30000")


def sa3d_gs(folder):
    save_ply_like_sa3d_gs(folder / ITERATION / "seg_point_cloud.ply", SCENE, OBJECT, [1.5, 0.1, 3])


def grouping(folder):
    (folder / ITERATION).mkdir(parents=True, exist_ok=True)
    save_ply(folder / ITERATION / "point_cloud.ply", SCENE.replace(extras=identity_columns(IDS)))
    weight = np.eye(8, 16, dtype=np.float32)[:, :, None, None]
    save(folder / ITERATION / "classifier.pth", {"weight": weight, "bias": np.zeros(8, np.float32)})


def opengaussian(folder):
    np.savez(folder / "cluster_lang.npz", leaf_feat=np.zeros((3, 512)), leaf_score=np.zeros(3), leaf_ind=IDS_ARRAY)


def sagd(folder):
    save_ply(folder / "point_cloud_seg.ply", SCENE, OBJECT)


def omniseg3d_gs(folder):
    save_ply(folder / ITERATION / "debug_robot_000.ply", SCENE, OBJECT)


def flashsplat(folder, place="used_count"):
    weights = np.stack([np.ones(N), np.where(IDS_ARRAY == 1, 3.0, 0.1)]).astype(np.float32)
    save(folder / place / "view_num_010_objnum_001.pth", weights)


def flashsplat_of_its_render(folder):
    flashsplat(folder, "train/ours_30000/used_count")


def cob_gs(folder):
    logits = np.where(IDS_ARRAY == 1, 5.0, -5.0).astype(np.float32)
    for iteration in (900, 22000):  # of COB-GS's and NG-GS's the latest counts
        state = checkpoint_entries(SCENE, logits if iteration > 900 else -logits)
        save(folder / "masks" / "The cup" / f"chkpnt{iteration}.pth", (state, iteration))
    save(folder / "masks" / "The cup" / "ngs_refiner22000.pth", {"weight": np.zeros(3)})


def just(path, value):
    """The method that saves one value at one place."""

    def method(folder):
        save(folder / path, value)

    method.__name__ = Path(path).stem
    return method


gaussian_cut = just("graphcut_cup/remove_source.pt", (~MASK).astype(float))
trace3d = just("objects/7_gaus_mask.pt", MASK)
saga = just("segmentation_res/cup.pt", MASK)


ID = {"object_id": (1,)}
METHODS = {
    saga: ("SAGA", {}),
    sa3d_gs: ("SA3D-GS", {}),
    just(ITERATION / "seg_point_cloud_0.npy", np.where(MASK, 2.5, -0.5).astype(np.float32)[:, None]): ("SA3D-GS", {}),
    grouping: ("Gaussian Grouping", ID),
    opengaussian: ("OpenGaussian", ID),
    just("cluster_result.pt", IDS_ARRAY): ("InstanceGaussian", ID),
    sagd: ("SAGD", {}),
    omniseg3d_gs: ("OmniSeg3D-GS", {}),
    flashsplat: ("FlashSplat", {}),
    flashsplat_of_its_render: ("FlashSplat", {}),
    cob_gs: ("COB-GS", {}),
    gaussian_cut: ("GaussianCut", {}),
    just("nag-l1.pt", IDS_ARRAY): ("THGS", ID),
    just("features.npy", np.where(MASK, 0.9, 0.1).astype(np.float32)[:, None]): ("LUDVIG", {"threshold": 0.5}),
    trace3d: ("Trace3D", {}),
    just("mask3d.pth", MASK): ("Gradient-Driven Segmentation", {}),
}


@pytest.fixture
def folder(tmp_path):
    save_to = tmp_path / "out" / "trex" / "point_cloud" / "iteration_30000"
    save_to.mkdir(parents=True)
    save_ply(save_to / "point_cloud.ply", SCENE)
    return tmp_path / "out" / "trex"


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.__name__)
def test_a_methods_folder_is_its_selection(folder, method):
    method(folder)
    name, options = METHODS[method]
    scene = formats.read(folder)
    assert np.flatnonzero(load_selection(folder, scene, SelectionOptions(**options))).tolist() == OBJECT
    text = describe_file(folder)
    assert f"selection of {name}" in text
    commands = [shlex.split(line) for line in text.splitlines() if "gaussian-trimmer trim" in line]
    assert len(commands) == 1 and commands[0][:2] == ["gaussian-trimmer", "trim"]
    scene_path, selection_path = commands[0][2:4]
    found = load_selection(selection_path, formats.read(scene_path), SelectionOptions(**options))
    assert np.flatnonzero(found).tolist() == OBJECT


def test_what_a_name_says_is_told(folder):
    gaussian_cut(folder)
    notes = []
    load_selection(folder, SCENE, say=notes.append)
    assert notes[0].endswith("remove_source.pt") and "mask of the background" in notes[1]
    save(folder / "scores.npy", np.linspace(-0.5, 1, N))
    with pytest.raises(InputError, match=r"holds scores from -0\.5"):
        load_selection(folder / "scores.npy", SCENE)


def test_the_trainings_own_checkpoint_is_no_second_selection(folder):
    saga(folder)
    save(folder / "chkpnt30000.pth", (checkpoint_entries(SCENE), 30_000))
    assert np.flatnonzero(load_selection(folder, SCENE)).tolist() == OBJECT


def test_a_folder_with_no_selection_or_several(folder):
    with pytest.raises(InputError, match="no file of a known segmentation method"):
        load_selection(folder, SCENE)
    gaussian_cut(folder)
    trace3d(folder)
    with pytest.raises(InputError, match=r"several selections; give one of them: .*remove_source\.pt, objects"):
        load_selection(folder, SCENE)


def gsplat_checkpoint(scene):
    splats = {
        "means": scene.means, "scales": scene.log_scales, "quats": scene.quaternions,
        "opacities": scene.opacity_logits, "sh0": scene.sh_dc[:, None], "shN": scene.sh_rest.transpose(0, 2, 1),
    }  # fmt: skip
    return {"step": 29_999, "splats": splats}


class TestCheckpointsAsScenes:
    def test_gsplat(self, tmp_path, capsys):
        path = tmp_path / "garden" / "ckpts" / "ckpt_29999_rank0.pt"
        save(path, gsplat_checkpoint(SCENE))
        save(path.with_name("ckpt_6999_rank0.pt"), gsplat_checkpoint(make_scene(3)))
        assert run("convert", tmp_path / "garden", tmp_path / "scene.ply") == 0
        written = formats.read(tmp_path / "scene.ply")
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
            assert np.array_equal(getattr(written, name), getattr(SCENE, name)), name
        assert run("info", path) == 0
        assert "checkpoint of iteration 29999, which can be the scene" in capsys.readouterr().out
        assert formats.written_suffix(path) == ".ply"

    def test_a_part_of_several_gpus_is_refused(self, tmp_path):
        for rank in (0, 1):
            save(tmp_path / f"ckpt_7_rank{rank}.pt", gsplat_checkpoint(SCENE))
        with pytest.raises(InputError, match="one GPU's part"):
            formats.read(tmp_path / "ckpt_7_rank0.pt")

    def test_inria_and_identity_features(self, tmp_path):
        save(tmp_path / "chkpnt30000.pth", (checkpoint_entries(SCENE), 30_000))
        assert np.array_equal(formats.read(tmp_path).sh_rest, SCENE.sh_rest)
        features = np.column_stack(list(identity_columns(IDS).values()))[:, None]
        save(tmp_path / "grouping.pth", (checkpoint_entries(SCENE, features), 7))
        grouping(tmp_path)
        scene = formats.read(tmp_path / "grouping.pth")
        chosen = load_selection(tmp_path / ITERATION / "classifier.pth", scene, SelectionOptions(object_id=(1,)))
        assert np.flatnonzero(chosen).tolist() == OBJECT

    def test_other_torch_files_are_no_scenes(self, tmp_path):
        save(tmp_path / "mask.pt", np.zeros(5))
        with pytest.raises(InputError, match=r"holds a Tensor and no scene.*a selection is given after its scene"):
            formats.read(tmp_path / "mask.pt")

    def test_a_cob_gs_checkpoint_of_other_gaussians_is_to_be_the_scene_as_well(self, folder):
        cob_gs(folder)
        with pytest.raises(InputError, match=r"match no row of the scene .* give 'chkpnt22000.pth' for the scene"):
            load_selection(folder, make_scene(7, seed=3))

    def test_cob_gs_from_its_folder_to_a_trim(self, tmp_path):
        scene, truth = toy.ball_on_floor()
        logits = np.where(toy.dilated(scene, truth), 4.0, -4.0).astype(np.float32)
        save(tmp_path / "masks" / "ball" / "chkpnt220.pth", (checkpoint_entries(scene, logits), 220))
        folder = tmp_path  # as good as masks/ball: the scene is that of the selection
        assert run("trim", folder, folder, "--output", tmp_path / "out", "--up", "z", "--quiet", *SMALL) == 0
        assert len(formats.read(tmp_path / "out" / "object.ply")) < int((logits > 0).sum())


class TestLangSplat:
    @pytest.fixture
    def place(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        masks, _ = save_capture(tmp_path, [f"frame_{i:05d}.jpg" for i in (6, 24, 60, 65)])
        for name, mask in list(masks.items())[1:]:
            answer = tmp_path / "eval" / "ramen" / name[6:11]
            answer.mkdir(parents=True)
            cv2.imwrite(str(answer / "chosen_yellow bowl.png"), mask)
            cv2.imwrite(str(answer / "chosen_egg.png"), np.zeros_like(mask))
        return tmp_path

    def test_info_prints_the_command_and_it_runs(self, place, capsys):
        assert run("info", "eval/ramen") == 0
        printed = [line for line in capsys.readouterr().out.splitlines() if "yellow" in line and "select" in line]
        words = shlex.split(printed[0])[1:]
        words[words.index("SCENE")], words[words.index("PATH")] = "scene.ply", "cameras.json"
        words[words.index("DIR")] = "trimmed"
        assert run(*words[: words.index("--trim")], "--output", "bowl.npy") == 0
        truth = toy.ball_on_floor()[1]
        assert (np.load("bowl.npy") == truth).mean() > 0.9

    def test_a_folder_without_a_prompt_names_one(self, place, capsys):
        assert run("select", "scene.ply", "--masks", "eval/ramen", "--cameras", "cameras.json") == 2
        assert "'eval/ramen/*/chosen_egg.png'" in capsys.readouterr().err


def test_scaffold_gs_is_recognised(tmp_path):
    names = ["x", "y", "z", "f_offset_0", "f_anchor_feat_0", "opacity", "scale_0", "scale_1", "rot_0"]
    header = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {name}\n" for name in names)
    (tmp_path / "point_cloud.ply").write_text(header + "end_header\n" + "0 " * len(names) + "\n")
    with pytest.raises(InputError, match=r"Scaffold-GS, as InstanceGaussian's.*select SCENE --masks"):
        formats.read(tmp_path / "point_cloud.ply")


def test_discs_become_thin_gaussians(tmp_path):
    (tmp_path / "point_cloud" / "iteration_sam_2000").mkdir(parents=True)
    path = save_ply(tmp_path / "point_cloud" / "iteration_sam_2000" / "point_cloud.ply", SCENE)
    path.write_bytes(path.read_bytes().replace(b"property float scale_2\n", b"property float other_2\n"))
    scene = formats.read(tmp_path)
    assert np.array_equal(scene.log_scales[:, :2], SCENE.log_scales[:, :2])
    np.testing.assert_allclose(scene.log_scales[:, 2], SCENE.log_scales[:, :2].min(axis=1) - np.log(1000), rtol=1e-6)
    assert "2D Gaussian Splatting" in describe_file(tmp_path) and scene.model == "2dgs"
    entries = list(checkpoint_entries(SCENE))
    entries[4] = entries[4][:, :2]
    save(tmp_path / "chkpnt2000.pth", (tuple(entries), 2000))
    assert np.array_equal(formats.read(tmp_path / "chkpnt2000.pth").log_scales, scene.log_scales)
    save(tmp_path / "chkpnt3000.pth", ((*entries, 0, 0), 3000))  # Trace3D's own, and ReferSplat's, are longer
    with pytest.raises(InputError, match=r"point_cloud\.ply"):
        formats.read(tmp_path / "chkpnt3000.pth")


class TestQueryPoint:
    def test_a_pixel_names_the_gaussian(self, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        save_capture(tmp_path, ["a.png", "b.png"])
        scene, truth = toy.ball_on_floor()
        save_ply(tmp_path / "scene.ply", scene.replace(extras=identity_columns(truth.astype(int).tolist())))
        common = ("scene.ply", "scene.ply", "--cameras", "cameras.json", "--quiet", *SMALL)
        camera = formats_camera(tmp_path)
        x, y = np.round(camera.project(scene.means[truth].mean(0, keepdims=True).astype(float))[0][0]).astype(int)
        query = ("--set", f"selection.query-point={x},{y}")
        assert run("trim", *common, *query, "--view", "b", "--output", "out") == 0
        selected = np.load("out/labels.npz")["selected"]
        assert np.array_equal(np.sort(selected), np.flatnonzero(truth))
        assert run("trim", *common, *query) == 2
        assert "Name the view of the queried pixel" in capsys.readouterr().err
        assert run("trim", *common, "--set", "selection.query-point=9999,5", "--view", "b") == 2
        assert "outside the view" in capsys.readouterr().err


def formats_camera(folder):
    from gaussian_trimmer.camera_files import read_camera_set

    return read_camera_set(folder / "cameras.json").pinhole_cameras()[1]
