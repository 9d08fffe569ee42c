"""From a method's output folder to its row before and after trimming, in one command, on small folders."""

import csv
import json
from dataclasses import replace

import cv2
import dataset_layouts
import numpy as np
import pytest
import toy
from command_line import SMALL, run
from dataset_layouts import SIZE
from selection_builders import checkpoint_state, classifier_state, identity_columns, save_ply

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera, intrinsics
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import TestView, Truth
from gaussian_trimmer.evaluation.layouts import DatasetTask, MaskedPicture
from gaussian_trimmer.evaluation.protocols import OWN_RULES, PROTOCOLS, protocol_of
from gaussian_trimmer.evaluation.rendered_masks import find_rendered
from gaussian_trimmer.evaluation.scoring import Judge, ObjectRender


def rows_of(path):
    with path.open() as file:
        return {next(iter(row.values())): row for row in csv.DictReader(file)}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_nvos_in_one_command(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    assert run("evaluate", "nvos", "nvos", "--predictions", "SAGA", "--output", "out", *SMALL) == 0
    printed = capsys.readouterr().out
    assert "NVOS with and without trimming" in printed and "occlusion counts" in printed
    assert "3 tasks, where NVOS has 8" in printed
    tasks = rows_of(folder / "out" / "nvos-SAGA.csv")
    assert list(tasks) == ["fern", "horns_center", "horns_left", "mean"]
    # Of the wrong picture, IoU would be far below this; the left half's selection is half of the target's mask.
    assert float(tasks["fern"]["IoU alone (%) after"]) > 90
    assert float(tasks["horns_center"]["IoU in scene (%) after"]) > 90
    assert float(tasks["horns_left"]["IoU alone (%) before"]) < 75
    alone = [float(tasks[name]["IoU alone (%) after"]) for name in ("fern", "horns_center", "horns_left")]
    assert float(tasks["mean"]["IoU alone (%) after"]) == pytest.approx(np.mean(alone), abs=1e-3)
    table = json.loads((folder / "out" / "nvos.json").read_text())
    assert all(row["figures"].startswith("measured") for row in table["rows"])  # these are of other protocols
    assert "--protocol cob-gs or sa3d or saga" in printed
    measured = [row for row in table["rows"] if row["figures"].startswith("measured")]
    assert [row["figures"] for row in measured] == ["measured, alone", "measured, in scene"]
    assert len(json.loads((folder / "out" / "runs.json").read_text())) == 3


def test_lerf_mask_takes_means_by_scene(folder, capsys):
    dataset_layouts.save_lerf_mask(folder / "lerf", folder / "grouping")
    assert run("evaluate", "lerf-mask", "lerf", "--predictions", "grouping", "--output", "out", *SMALL) == 0
    rows = rows_of(folder / "out" / "lerf-mask-grouping.csv")
    assert list(rows) == ["figurines/ball's rim", "figurines/red ball", "figurines, mean", "mean"]
    assert rows["figurines/red ball"]["views"] == "2"
    assert float(rows["mean"]["IoU alone (%) after"]) > 90
    assert "mBIoU" in (folder / "out" / "lerf-mask.csv").read_text()
    statistics = rows_of(folder / "out" / "lerf-mask-statistics.csv")
    assert statistics["grouping"]["scenes"] == "1"
    assert "no published figures" in capsys.readouterr().out


def test_several_methods_share_a_table(folder, capsys):
    for method in ("SAGA", "SAGD"):
        dataset_layouts.save_spin_nerf(folder / "spin", folder / method)
    arguments = ["--predictions", "SAGA", "SAGD", "--preset", "paper", "--json", *SMALL]
    assert run("evaluate", "spin-nerf", "spin", *arguments) == 0
    tasks, _, means, statistics = json.loads(capsys.readouterr().out)  # one document for all tables
    before, after = (tasks["rows"][0][f"IoU alone (%) {when}"] for when in ("before", "after"))
    assert tasks["rows"][0]["views"] == 2 and after > before + 1
    measured = [(row["method"], row["figures"]) for row in means["rows"] if "measured" in row["figures"]]
    assert measured == [(method, f"measured, {rule}") for method in ("SAGA", "SAGD") for rule in ("alone", "in scene")]
    assert any("preset 'paper', 5 views, grabcut" in note for note in means["notes"])
    (row,) = (row for row in statistics["rows"] if row["method"] == "SAGD" and row["metric"] == "IoU")
    assert row["gain mean"] == pytest.approx(after - before, abs=1e-3) and row["gain low"] is None
    assert row["losing"] == 0 and row["worst object"] == "lego/lego"
    assert any("made by gaussian-trimmer" in note for note in statistics["notes"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--predictions", "nowhere"], "no folder 'nowhere'"),
        (["--predictions", "SAGA", "other/SAGA"], "different names"),
        (["--predictions", "SAGA", "--tasks", "trex"], "no task 'trex'"),
        ([], "after --predictions or --masks-only; given: none"),
        (["--predictions", "SAGA", "--protocol", "usual"], "available: own, cob-gs, saga, sa3d"),
        (["--predictions", "SAGA", "--protocol", "sa3d", "--threshold", "0.2"], "'sa3d' has the threshold 0.1"),
        (["--predictions", "SAGA", "--ids", "nowhere.csv"], "no file 'nowhere.csv'"),
        (["--predictions", "SAGA", "--threshold", "-1"], "threshold"),
        (["--predictions", "SAGA", "--selections", "{scene}/*.npy"], "files that may be its selection"),
    ],
)
def test_what_cannot_be_used_is_found_before_the_first_trim(folder, capsys, arguments, message):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    assert run("evaluate", "nvos", "nvos", *arguments, *SMALL) == 2
    captured = capsys.readouterr()
    assert message in captured.err and not captured.out


def test_a_target_that_the_cameras_lack_is_named(folder, capsys):
    dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
    cameras = folder / "SAGA" / "fern" / "cameras.json"
    cameras.write_text(cameras.read_text().replace("IMG_4027", "IMG_5000"))
    assert run("evaluate", "nvos", "nvos", "--predictions", "SAGA", *SMALL) == 2
    assert "IMG_4027" in capsys.readouterr().err


def test_an_object_that_is_not_the_scenes_cannot_be_trimmed(folder, capsys):
    dataset_layouts.save_spin_nerf(folder / "spin", folder / "method")
    scene = formats.read(folder / "method" / "lego" / "scene.ply")
    (folder / "method" / "lego" / "selection.npy").unlink()
    strange = scene.select(slice(0, 50)).replace(means=scene.means[50:100] * 3, sh_dc=scene.sh_dc[:50] + 5)
    formats.write(strange, folder / "method" / "lego" / "object.ply")
    assert run("evaluate", "spin-nerf", "spin", "--predictions", "method", *SMALL) == 2
    assert "cannot start" in capsys.readouterr().err


class TestProtocols:
    def test_published_figures_stand_beside_the_same_protocol(self, folder, capsys):
        dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
        arguments = ["--predictions", "SAGA", "--tasks", "fern", "--output", "out", "--protocol", "cob-gs"]
        assert run("evaluate", "nvos", "nvos", *arguments, *SMALL) == 0
        table = json.loads((folder / "out" / "nvos.json").read_text())
        figures = {row["method"]: row["figures"] for row in table["rows"]}
        assert list(figures) == ["COB-GS", "NG-GS", "SAGA"] and figures["COB-GS"] == "GaussianTrimmer, Table I"
        assert figures["SAGA"] == "measured, alone"  # the one rule of occlusion of this protocol
        assert "ZestfulJX/COB-GS" in capsys.readouterr().out
        settings = json.loads((folder / "out" / "settings.json").read_text())
        assert settings["protocol"] == "cob-gs" and settings["config"]["plan"]["views"] == 5
        assert any("cob-gs" in note for note in settings["tables"]["nvos"]["notes"])  # beside the CSV, which has none

    def test_views_are_rendered_at_the_protocols_size_and_masks_enlarged(self):
        camera = Camera(np.eye(4), intrinsics(1.0, 40, 30), 40, 30, "a.jpg")
        coverage = np.full((60, 80), 128 / 255, np.float32)
        truth = Truth(coverage, coverage > 0)
        view = TestView(replace(camera, width=80, height=60), None, truth, truth)
        seen = PROTOCOLS["nvos"]["cob-gs"].view(view, camera)
        assert (seen.camera.width, seen.camera.height) == (1008, 756)
        assert seen.camera.K[0, 0] == pytest.approx(camera.K[0, 0] * 1008 / 40)
        assert not seen.alone.coverage.any()  # 128 is not above 128
        seen = PROTOCOLS["lerf-mask"]["gaussian-grouping"].view(view, camera)
        assert (seen.camera.width, seen.camera.height) == (40, 30)
        assert protocol_of("nvos", "own").view(view, camera).camera.width == 80
        shown = ObjectRender(np.zeros((30, 40, 3), np.float32), np.ones((30, 40), np.float32))
        judge = Judge()
        assert judge.score(shown, TestView(camera, None, truth, truth))["iou"] == 100

    def test_spin_nerf_pairs_by_order_and_counts_the_reference_or_not(self, folder):
        dataset_layouts.save_spin_nerf(folder / "spin", folder / "method")
        write = dataset_layouts.write
        masks = sorted((folder / "spin" / "lego" / "images_4" / "label").glob("image00?.png"))
        write(masks[0].with_name("image000.png"), np.zeros((96, 96), np.uint8))  # that of the reference is wrong
        cameras = folder / "method" / "lego" / "cameras.json"
        cameras.write_text(cameras.read_text().replace("image0", "2022_"))
        common = ("spin", "--predictions", "method", "--output", "out", "--overwrite", *SMALL)
        assert run("evaluate", "spin-nerf", *common) == 2

        def measured(protocol):
            assert run("evaluate", "spin-nerf", *common, "--protocol", protocol) == 0
            row = rows_of(folder / "out" / "spin-nerf-method.csv")["lego"]
            return row["views"], float(row["IoU in scene (%) after"])

        (all_views, mean), (others, without) = measured("usual"), measured("without-reference")
        assert (all_views, others) == ("3", "2") and without > 90
        assert mean == pytest.approx(without * 2 / 3, abs=0.01)


class TestMasksOnly:
    def test_a_methods_own_masks_are_scored_as_its_code_scores_them(self, folder, capsys):
        dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
        large = cv2.imread(str(folder / "nvos" / "masks" / "fern" / "IMG_4027_mask.png"), cv2.IMREAD_GRAYSCALE)
        small = large[1::3, 1::3].copy()
        small[:, : SIZE // 2] = 0  # half of the object is missing
        place = folder / "COB-GS" / "fern" / "test" / "ours_22x" / "mask_renders" / "fern leaf"
        for name, picture in (("00000.png", small), ("00001.png", 255 - small)):
            dataset_layouts.write(place / name, picture)
        arguments = ["nvos", "--masks-only", "COB-GS", "--tasks", "fern", "--protocol", "cob-gs", "--output", "out"]
        assert run("evaluate", "nvos", *arguments) == 0
        found, truth = np.kron(small > 128, np.ones((3, 3), bool)), large > 128
        row = rows_of(folder / "out" / "nvos-COB-GS.csv")["fern"]
        expected = 100 * (found & truth).sum() / (found | truth).sum()
        assert float(row["IoU alone (%) before"]) == pytest.approx(expected, abs=1e-4)
        assert row["IoU alone (%) after"] == ""
        said = capsys.readouterr().out
        assert "ground truth > 0.501961" in said and "ground truth > 0.5;" not in said  # one threshold, not two

    @pytest.mark.parametrize(
        "place",
        ["{scene}/{i}/egg", "{scene}/v{i}/egg", "egg/v{i}", "{scene}/v{i}/chosen_egg", "{scene}/{i}/chosen_egg",
         "{scene}/test/ours_30000_text/test_mask/{i}/egg", "{scene}/x/ours_7/renders_cluster_silhouette/v{i}_egg"],
    )  # fmt: skip
    @pytest.mark.parametrize("given", ["result", "result/ramen"])
    def test_masks_are_found_where_methods_write_them(self, folder, place, given):
        if given != "result" and not place.startswith("{scene}"):
            return
        pictures = tuple(MaskedPicture(f"v{i}", folder / "gt" / str(i) / "egg.png") for i in (3, 12))
        for i in (3, 12):
            dataset_layouts.write(folder / "result" / f"{place.format(scene='ramen', i=i)}.png", np.ones((2, 2)))
        found = find_rendered(folder / given, DatasetTask("ramen", "egg", pictures), OWN_RULES)
        assert len({path.resolve() for path in found}) == 2

    def test_open_gaussians_rules(self, folder, capsys):
        masks, _ = dataset_layouts.save_capture(folder / "method" / "ramen", ["frame_00006.jpg", "frame_00024.jpg"])
        place = folder / "result" / "ramen" / "train" / "ours_70000" / "renders_cluster_silhouette"
        for name, mask in masks.items():
            for part in ("egg", "[egg] 2"):
                dataset_layouts.write(folder / "ovs" / "ramen" / "segmentations" / name[:-4] / f"{part}.png", mask)
            dataset_layouts.write(folder / "ovs" / "ramen" / "images" / name, mask)
            dataset_layouts.write(place / f"{name[:-4]}_egg.png", mask // 20)  # faint, and above 10 of 255
        dataset_layouts.write(place / "frame_00006_[egg] 2.png", masks["frame_00006.jpg"])
        arguments = ["3d-ovs", "ovs", "--masks-only", "result", "--output", "out", "--overwrite"]
        assert run("evaluate", *arguments, "--protocol", "opengaussian") == 0
        rows = rows_of(folder / "out" / "3d-ovs-result.csv")
        figures = [rows[f"ramen/{part}"]["IoU alone (%) before"] for part in ("egg", "[egg] 2")]
        assert list(map(float, figures)) == [100, 50]
        assert float(rows["mean"]["Acc@0.25 alone (%) before"]) == 75
        assert "Acc@0.25" in capsys.readouterr().out
        assert run("evaluate", *arguments) == 2  # by other rules, none may be missing
        assert "[egg] 2" in capsys.readouterr().err

    def test_words_of_a_data_set_do_not_lead_out_of_the_folder(self, folder):
        dataset_layouts.write(folder / "secret.png", np.zeros((9, 9), np.uint8))
        (folder / "masks").mkdir()
        for words in ("../secret", str(folder / "secret")):
            task = DatasetTask("ramen", words, (MaskedPicture("a", folder / "m.png"),))
            with pytest.raises(InputError, match="no rendered masks"):
                find_rendered(folder / "masks", task, OWN_RULES)

    def test_a_scenes_mask_is_not_taken_for_two_objects_in_the_same_picture(self, folder, capsys):
        dataset_layouts.save_nvos(folder / "nvos", folder / "SAGA")
        mask = np.full((SIZE, SIZE), 255, np.uint8)
        dataset_layouts.write(folder / "masks" / "horns" / "DJI_0003.png", mask)
        arguments = ["nvos", "--masks-only", "masks", "--tasks", "horns_center"]
        assert run("evaluate", "nvos", *arguments) == 2
        assert "no rendered masks" in capsys.readouterr().err
        dataset_layouts.write(folder / "masks" / "horns_center.png", mask)
        assert run("evaluate", "nvos", *arguments) == 0


class TestIds:
    @pytest.mark.needs("torch")
    def test_one_classifier_serves_all_tasks_of_a_scene(self, folder, capsys):
        import torch

        dataset_layouts.save_lerf_mask(folder / "lerf", folder / "grouping")
        home = folder / "grouping" / "figurines"
        for name in ("red ball.npy", "ball's rim.npy"):
            (home / name).unlink()
        scene, truth = toy.ball_on_floor()
        scene = scene.replace(extras=identity_columns(toy.dilated(scene, truth).astype(int).tolist()))
        (home / "scene.ply").unlink()
        place = home / "point_cloud" / "iteration_30000"
        place.mkdir(parents=True)
        save_ply(place / "point_cloud.ply", scene)
        torch.save(classifier_state(8), place / "classifier.pth")
        (folder / "ids.csv").write_text("task,id\nfigurines/red ball,1\nfigurines/ball's rim,1\n")
        command = ("evaluate", "lerf-mask", "lerf", "--predictions", "grouping", *SMALL)
        assert run(*command, "--ids", "ids.csv", "--output", "out") == 0
        assert float(rows_of(folder / "out" / "lerf-mask-grouping.csv")["mean"]["IoU alone (%) after"]) > 90
        (folder / "ids.csv").write_text("figurines/red ball,1\n")
        assert run(*command, "--ids", "ids.csv") == 2
        assert "no row of the task 'figurines/ball's rim'" in capsys.readouterr().err
        (folder / "ids.csv").write_text("figurines/red ball,one\n")
        assert run(*command, "--ids", "ids.csv") == 2
        assert "'figurines/red ball' without ids" in capsys.readouterr().err

    @pytest.mark.needs("torch")
    def test_a_cob_gs_checkpoint_is_scene_and_selection(self, folder):
        import torch

        dataset_layouts.save_nvos(folder / "nvos", folder / "COB-GS")
        home = folder / "COB-GS" / "fern"
        scene, truth = toy.ball_on_floor()
        (home / "selection.npy").unlink()
        (home / "scene.ply").unlink()
        logits = torch.where(torch.tensor(toy.dilated(scene, truth)), 4.0, -4.0)
        (home / "masks" / "fern").mkdir(parents=True)
        for iteration in (40, 220):
            torch.save((checkpoint_state(scene, logits), iteration), home / "masks" / "fern" / f"chkpnt{iteration}.pth")
        command = ("evaluate", "nvos", "nvos", "--predictions", "COB-GS", "--tasks", "fern", "--output", "out", *SMALL)
        assert run(*command) == 0
        assert float(rows_of(folder / "out" / "nvos-COB-GS.csv")["fern"]["IoU alone (%) after"]) > 90


def test_lerf_ovs_has_polygons(folder, capsys):
    masks, _ = dataset_layouts.save_capture(
        folder / "method" / "ramen", ["frame_00006.jpg", "frame_00024.jpg"], "egg.npy"
    )
    for name, mask in masks.items():
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        objects = [{"category": "egg", "bbox": [], "segmentation": c[:, 0].tolist()} for c in contours]
        objects += [{"category": "corner", "bbox": [], "segmentation": [[0, 0], [9, 0], [9, 9], [0, 9]]}] * 2
        info = {"name": name, "width": SIZE, "height": SIZE}
        file = folder / "lerf_ovs" / "label" / "ramen" / name.replace(".jpg", ".json")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps({"info": info, "objects": objects}))
    arguments = ["lerf_ovs", "--predictions", "method", "--tasks", "ramen/egg", "--output", "out"]
    assert run("evaluate", "lerf-ovs", *arguments, *SMALL) == 0
    assert float(rows_of(folder / "out" / "lerf-ovs-method.csv")["ramen/egg"]["IoU in scene (%) after"]) > 90
    assert "all objects in all views of a scene, then over scenes" in capsys.readouterr().out
    file.write_text(
        '{"info": {"width": 5, "height": 5}, "objects": [{"category": "egg", "segmentation": [[1e30, 2]]}]}'
    )
    assert run("evaluate", "lerf-ovs", *arguments, "--overwrite") == 2
    assert "holds no polygons" in capsys.readouterr().err


def test_3d_ovs(folder):
    masks, pictures = dataset_layouts.save_capture(folder / "method" / "bed", ["00.jpg", "05.jpg"], "red bag.npy")
    for name, mask in masks.items():
        dataset_layouts.write(folder / "ovs" / "bed" / "images" / name, pictures[name])
        dataset_layouts.write(folder / "ovs" / "bed" / "segmentations" / name[:2] / "red bag.png", mask)
    assert run("evaluate", "3d-ovs", "ovs", "--predictions", "method", "--output", "out", *SMALL) == 0
    assert float(rows_of(folder / "out" / "3d-ovs-method.csv")["bed/red bag"]["IoU in scene (%) after"]) > 90
