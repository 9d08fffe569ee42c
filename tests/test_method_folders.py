"""What segmentation methods leave in their folders: recognised by `info`, and taken by one command."""

from __future__ import annotations

import shlex

import cv2
import numpy as np
import pytest
import toy
from command_line import SMALL, run
from dataset_layouts import save_capture
from selection_builders import (
    checkpoint_state,
    classifier_state,
    identity_columns,
    make_scene,
    rows_mask,
    save_ply,
    save_ply_like_sa3d_gs,
)

from gaussian_trimmer import formats
from gaussian_trimmer.commands.inspection import describe_file
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

N = 12
SCENE = make_scene(N)
IDS = [0, 1, 1, 2, 0, 1, 0, 0, 2, 0, 0, 0]
OBJECT = [1, 2, 5]


def torch_save(value, path):
    torch = pytest.importorskip("torch", reason="these files are written with torch")
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(value, path)


def numpy_save(value, path):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, value)


def saga(folder):
    import torch

    torch_save(torch.tensor(rows_mask(N, *OBJECT)), folder / "segmentation_res" / "cup.pt")


def sa3d_gs(folder):
    part = folder / "point_cloud" / "iteration_30000"
    save_ply_like_sa3d_gs(part / "seg_point_cloud.ply", SCENE, OBJECT, [1.5, 0.1, 3])


def sa3d_gs_logits(folder):
    logits = np.where(rows_mask(N, *OBJECT), 2.5, -0.5).astype(np.float32)
    numpy_save(logits[:, None], folder / "point_cloud" / "iteration_30000" / "seg_point_cloud_0.npy")


def grouping(folder):
    scene = SCENE.replace(extras=identity_columns(IDS))
    save_ply(folder / "point_cloud" / "iteration_30000" / "point_cloud.ply", scene)
    torch_save(classifier_state(8), folder / "point_cloud" / "iteration_30000" / "classifier.pth")


def opengaussian(folder):
    np.savez(folder / "cluster_lang.npz", leaf_feat=np.zeros((3, 512)), leaf_score=np.zeros(3), leaf_ind=np.array(IDS))


def instancegaussian(folder):
    import torch

    torch_save(torch.tensor(IDS), folder / "cluster_result.pt")


def sagd(folder):
    save_ply(folder / "point_cloud_seg.ply", SCENE, OBJECT)


def flashsplat(folder):
    import torch

    weights = torch.stack([torch.ones(N), torch.where(torch.tensor(IDS) == 1, 3.0, 0.1)])
    torch_save(weights, folder / "used_count" / "view_num_010_objnum_001.pth")


def cob_gs(folder):
    import torch

    logits = torch.where(torch.tensor(IDS) == 1, 5.0, -5.0)
    for iteration in (900, 22000):  # of COB-GS's and NG-GS's the latest counts
        state = checkpoint_state(SCENE, torch.nn.Parameter(logits if iteration > 900 else -logits))
        torch_save((state, iteration), folder / "masks" / "The cup" / f"chkpnt{iteration}.pth")
    torch_save({"weight": torch.zeros(3)}, folder / "masks" / "The cup" / "ngs_refiner22000.pth")


def gaussian_cut(folder):
    import torch

    removed = np.ones(N)
    removed[OBJECT] = 0
    torch_save(torch.from_numpy(removed), folder / "graphcut_cup" / "remove_source.pt")


def thgs(folder):
    import torch

    torch_save(torch.tensor(IDS), folder / "nag-l1.pt")


def ludvig(folder):
    numpy_save(np.where(rows_mask(N, *OBJECT), 0.9, 0.1).astype(np.float32)[:, None], folder / "features.npy")


def trace3d(folder):
    import torch

    torch_save(torch.tensor(rows_mask(N, *OBJECT)), folder / "objects" / "7_gaus_mask.pt")


ID = {"object_id": (1,)}
METHODS = {
    saga: ("SAGA", {}),
    sa3d_gs: ("SA3D-GS", {}),
    sa3d_gs_logits: ("SA3D-GS", {}),
    grouping: ("Gaussian Grouping", ID),
    opengaussian: ("OpenGaussian", ID),
    instancegaussian: ("InstanceGaussian", ID),
    sagd: ("SAGD", {}),
    flashsplat: ("FlashSplat", {}),
    cob_gs: ("COB-GS", {}),
    gaussian_cut: ("GaussianCut", {}),
    thgs: ("THGS", ID),
    ludvig: ("LUDVIG", {"threshold": 0.5}),
    trace3d: ("Trace3D", {}),
}


@pytest.fixture
def folder(tmp_path):
    save_to = tmp_path / "out" / "trex" / "point_cloud" / "iteration_30000"
    save_to.mkdir(parents=True)
    save_ply(save_to / "point_cloud.ply", SCENE)
    return tmp_path / "out" / "trex"


@pytest.mark.needs("torch")
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


@pytest.mark.needs("torch")
def test_what_a_name_says_is_told(folder):
    gaussian_cut(folder)
    notes = []
    load_selection(folder, SCENE, say=notes.append)
    assert notes[0].endswith("remove_source.pt") and "mask of the background" in notes[1]
    with pytest.raises(InputError, match=r"holds scores from -0\.5"):
        numpy_save(np.linspace(-0.5, 1, N), folder / "scores.npy")
        load_selection(folder / "scores.npy", SCENE)


@pytest.mark.needs("torch")
def test_the_trainings_own_checkpoint_is_no_second_selection(folder):
    saga(folder)
    torch_save((checkpoint_state(SCENE), 30_000), folder / "chkpnt30000.pth")
    assert np.flatnonzero(load_selection(folder, SCENE)).tolist() == OBJECT


@pytest.mark.needs("torch")
def test_a_folder_with_no_selection_or_several(folder):
    with pytest.raises(InputError, match="no file of a known segmentation method"):
        load_selection(folder, SCENE)
    gaussian_cut(folder)
    trace3d(folder)
    with pytest.raises(InputError, match=r"several selections; give one of them: .*remove_source\.pt, objects"):
        load_selection(folder, SCENE)


def gsplat_checkpoint(scene):
    import torch

    sh = torch.tensor(scene.sh_rest).transpose(1, 2).contiguous()
    splats = torch.nn.ParameterDict({
        "means": torch.tensor(scene.means), "scales": torch.tensor(scene.log_scales),
        "quats": torch.tensor(scene.quaternions), "opacities": torch.tensor(scene.opacity_logits),
        "sh0": torch.tensor(scene.sh_dc)[:, None], "shN": sh,
    })  # fmt: skip
    return {"step": 29_999, "splats": splats.state_dict()}


@pytest.mark.needs("torch")
class TestCheckpointsAsScenes:
    def test_gsplat(self, tmp_path, capsys):
        path = tmp_path / "garden" / "ckpts" / "ckpt_29999_rank0.pt"
        torch_save(gsplat_checkpoint(SCENE), path)
        torch_save(gsplat_checkpoint(make_scene(3)), path.with_name("ckpt_6999_rank0.pt"))
        assert run("convert", tmp_path / "garden", tmp_path / "scene.ply") == 0
        written = formats.read(tmp_path / "scene.ply")
        for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest"):
            assert np.array_equal(getattr(written, name), getattr(SCENE, name)), name
        assert run("info", path) == 0
        assert "checkpoint of iteration 29999, which can be the scene" in capsys.readouterr().out
        assert formats.written_suffix(path) == ".ply"

    def test_a_part_of_several_gpus_is_refused(self, tmp_path):
        for rank in (0, 1):
            torch_save(gsplat_checkpoint(SCENE), tmp_path / f"ckpt_7_rank{rank}.pt")
        with pytest.raises(InputError, match="one GPU's part"):
            formats.read(tmp_path / "ckpt_7_rank0.pt")

    def test_inria_and_identity_features(self, tmp_path):
        import torch

        torch_save((checkpoint_state(SCENE), 30_000), tmp_path / "chkpnt30000.pth")
        assert np.array_equal(formats.read(tmp_path).sh_rest, SCENE.sh_rest)
        features = np.column_stack(list(identity_columns(IDS).values()))[:, None]
        torch_save((checkpoint_state(SCENE, torch.tensor(features)), 7), tmp_path / "grouping.pth")
        torch_save(classifier_state(8), tmp_path / "classifier.pth")
        scene = formats.read(tmp_path / "grouping.pth")
        chosen = load_selection(tmp_path / "classifier.pth", scene, SelectionOptions(object_id=(1,)))
        assert np.flatnonzero(chosen).tolist() == OBJECT

    def test_other_torch_files_are_no_scenes(self, tmp_path):
        import torch

        torch_save(torch.zeros(5), tmp_path / "mask.pt")
        with pytest.raises(InputError, match=r"holds a Tensor and no scene.*A selection is given after its scene"):
            formats.read(tmp_path / "mask.pt")

    def test_a_cob_gs_checkpoint_of_other_gaussians_is_to_be_the_scene_as_well(self, folder):
        cob_gs(folder)
        with pytest.raises(InputError, match=r"match no row of the scene .* give 'chkpnt22000.pth' for the scene"):
            load_selection(folder, make_scene(7, seed=3))

    def test_cob_gs_from_its_folder_to_a_trim(self, tmp_path):
        import torch

        scene, truth = toy.ball_on_floor()
        logits = torch.where(torch.tensor(toy.dilated(scene, truth)), 4.0, -4.0)
        folder = tmp_path / "masks" / "ball"
        torch_save((checkpoint_state(scene, logits), 220), folder / "chkpnt220.pth")
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


def test_scaffold_gs_and_discs_are_recognised(tmp_path):
    names = ["x", "y", "z", "f_offset_0", "f_anchor_feat_0", "opacity", "scale_0", "scale_1", "rot_0"]
    header = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {name}\n" for name in names)
    (tmp_path / "point_cloud.ply").write_text(header + "end_header\n" + "0 " * len(names) + "\n")
    with pytest.raises(InputError, match=r"Scaffold-GS, as InstanceGaussian's.*select SCENE --masks"):
        formats.read(tmp_path / "point_cloud.ply")
    path = save_ply(tmp_path / "discs.ply", make_scene(3))
    data = path.read_bytes().replace(b"property float scale_2\n", b"property float other_2\n")
    path.write_bytes(data)
    with pytest.raises(InputError, match="2D Gaussian Splatting"):
        formats.read(path)


class TestQueryPoint:
    def test_a_pixel_names_the_gaussian(self, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        save_capture(tmp_path, ["a.png", "b.png"])
        scene, truth = toy.ball_on_floor()
        save_ply(tmp_path / "scene.ply", scene.replace(extras=identity_columns(truth.astype(int).tolist())))
        common = ("scene.ply", "scene.ply", "--cameras", "cameras.json", "--quiet", *SMALL)
        camera = formats_camera(tmp_path)
        x, y = np.round(camera.project(scene.means[truth].mean(0, keepdims=True).astype(float))[0][0]).astype(int)
        query = ("--selection.query-point", x, y)
        assert run("trim", *common, *query, "--view", "b", "--output", "out") == 0
        selected = np.load("out/labels.npz")["selected"]
        assert np.array_equal(np.sort(selected), np.flatnonzero(truth))
        assert run("trim", *common, *query) == 2
        assert "Name the view of the queried pixel" in capsys.readouterr().err
        assert run("trim", *common, "--selection.query-point", 9999, 5, "--view", "b") == 2
        assert "outside the view" in capsys.readouterr().err


def formats_camera(folder):
    from gaussian_trimmer.camera_files import read_camera_set

    return read_camera_set(folder / "cameras.json").pinhole_cameras()[1]
