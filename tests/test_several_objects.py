"""Several objects of one scene: each as it would be alone, none with a Gaussian of another, and what is written."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import toy
from command_line import SMALL, run

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.output.pictures import cameras_around
from gaussian_trimmer.selection_files import load_objects
from gaussian_trimmer.trimming.arguments import rough_objects
from gaussian_trimmer.trimming.config import EvidenceConfig, RefineConfig, SplitConfig
from gaussian_trimmer.trimming.result import RowLabel
from gaussian_trimmer.trimming.trim import trim_objects

CONFIG = toy.small_config()
SHIFT = np.float32([2.4, 0, 0])
SCENE, FIRST, SECOND = toy.two_balls(SHIFT)


def rough(truth, centre, reach=0.4):
    return truth | (np.linalg.norm(SCENE.means - centre, axis=1) < toy.RADIUS + reach)


ROUGH = {3: rough(FIRST, toy.CENTRE), 7: rough(SECOND, toy.CENTRE + SHIFT)}


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def result():
    return trim_objects(SCENE, ROUGH, config=CONFIG)


def check_complementary(result):
    """Every row is in one object, in the background, or split between one object and the background."""
    owners = [np.unique(part.source_index) for part in result.objects]
    together = np.concatenate([*owners, result.rest.rows, result.discarded])
    assert len(np.unique(together)) == len(together) == len(result.scene)
    split = np.concatenate([part.source_index[part.label == RowLabel.SPLIT_INSIDE] for part in result.objects])
    outer = result.background_source[result.background_label == RowLabel.SPLIT_OUTSIDE]
    assert set(outer) <= set(split)
    assert len(result.background) == len(result.background_source) == len(result.background_label)


def test_shares_are_what_labels_were_made_of(result):
    share, labels = result.share, result.labels
    assert share.shape == labels.shape and share.min() == 0 and share.max() <= 1
    whole = np.concatenate([part.source_index[part.label != RowLabel.SPLIT_INSIDE] for part in result.objects])
    assert (share[whole] > 0.5).all() and (share > 0.5).sum() <= 1.02 * (labels > 0).sum()
    assert len(np.unique(share)) > 10  # not a mask
    left = trim_objects(SCENE, ROUGH, config=replace(CONFIG, acceptance=replace(CONFIG.acceptance, max_wrong=0.0)))
    refused = [part for part in left.objects if part.refused]
    assert refused and all((left.share[part.source_index] == 1).all() for part in refused)


def test_each_object_is_as_it_would_be_alone(result):
    check_complementary(result)
    assert [part.id for part in result.objects] == [3, 7]
    for part, truth in zip(result.objects, (FIRST, SECOND), strict=True):
        alone = gt.trim(SCENE, ROUGH[part.id], config=CONFIG)
        mask = np.zeros(len(SCENE), np.bool_)
        mask[part.source_index] = True
        assert toy.jaccard(mask, alone.object_mask) > 0.99
        assert toy.jaccard(mask, truth) > 0.95
    assert np.array_equal(result.labels == 3, np.isin(np.arange(len(SCENE)), result.objects[0].source_index))


def test_what_two_objects_claim_goes_to_one():
    half = ROUGH[3] & (SCENE.means[:, 0] < 0.3)
    result = trim_objects(SCENE, {1: ROUGH[3], 2: half, 5: ROUGH[7]}, config=CONFIG)
    check_complementary(result)
    assert result.contested > 100
    assert sum(part.lost for part in result.objects) == result.contested


def test_split_gaussians_have_one_owner():
    config = toy.small_config(split=SplitConfig("plane"))
    result = trim_objects(SCENE, {1: ROUGH[3], 2: ROUGH[3] | ROUGH[7]}, config=config)
    assert sum(np.count_nonzero(part.label == RowLabel.SPLIT_INSIDE) for part in result.objects)
    check_complementary(result)


def test_outlines_are_fitted_once_contested_gaussians_have_an_owner():
    """What was fitted alone and then lost a part is another outline than the one that was fitted."""
    halves = [ROUGH[3] & (SCENE.means[:, 0] * side < 0.3) for side in (1, -1)]
    config = replace(CONFIG, refine="fit", refinement=RefineConfig(steps=2, max_thin=1))
    contested = trim_objects(SCENE, halves, config=config)
    loser = max(contested.objects, key=lambda part: part.lost)
    assert loser.lost > 20
    assert len(loser.fitted)


@pytest.mark.parametrize(
    ("objects", "ids", "names"),
    [
        ([ROUGH[3], ROUGH[7]], [1, 2], ["1", "2"]),
        ({"red": ROUGH[3], "blue": ROUGH[7]}, [1, 2], ["red", "blue"]),
        ({np.int64(9): ROUGH[3]}, [9], ["9"]),
    ],
)
def test_objects_may_have_names_or_neither(objects, ids, names):
    result = trim_objects(SCENE, objects, config=CONFIG, views=3, up="z")
    assert [part.id for part in result.objects] == ids
    assert [part.name for part in result.objects] == names
    assert set(np.unique(result.labels)) == {0, *ids}
    assert all(len(part.views) == 3 for part in result.objects)


@pytest.mark.parametrize(
    ("objects", "sentence"),
    [
        ({}, "no object to trim"),
        (np.zeros(3), "The objects are an array of float64"),
        ({1: ROUGH[3][:-1]}, "booleans are needed"),
    ],
)
def test_objects_that_cannot_be_used_are_named(objects, sentence):
    with pytest.raises(InputError, match=sentence):
        trim_objects(SCENE, objects)


def test_the_whole_object_is_in_the_pictures_from_both_sides(result):
    for part in result.objects:
        for way in np.eye(3):
            middle = part.bounds.centre
            means = middle + (part.gaussians.means - middle) @ (np.eye(3) + np.outer(way, way)) + 0.5 * way
            wide = replace(part, gaussians=part.gaussians.replace(means=means.astype(np.float32)))
            for camera in cameras_around(wide, part.gaussians, 0, 2, 100)[1]:
                assert camera.contains(camera.project(means)[0]).all()


@pytest.mark.parametrize("keys", [(0, 1), (-1, 5)])
def test_keys_below_one_are_names_and_numbers_begin_at_one(keys, result):
    found = trim_objects(SCENE, dict(zip(keys, ROUGH.values(), strict=True)), config=CONFIG)
    assert [(part.id, part.name) for part in found.objects] == [(1, str(keys[0])), (2, str(keys[1]))]
    for part in found.objects:
        assert np.array_equal(np.flatnonzero(found.labels == part.id), np.unique(part.source_index))
    for entry, expected, key in zip(gt.describe(found)["objects"], gt.describe(result)["objects"], keys, strict=True):
        for told in ("counts", "warnings", "shrunk_side"):
            assert entry[told] == expected[told]
        assert entry["file"] == f"object_{abs(key)}.ply" and entry["name"] == str(key)


def test_ids_of_gaussians_are_objects():
    labels = np.zeros(len(SCENE), np.int32)
    for number, mask in ROUGH.items():
        labels[mask] = number
    labels[-1] = -1
    found = rough_objects(labels, len(SCENE))
    assert [(part.id, part.name) for part in found] == [(3, "3"), (7, "7")]
    for part in found:
        assert np.array_equal(part.rows, np.flatnonzero(labels == part.id))
    for wrong, sentence in (
        (labels > 0, "array of bool"),
        (labels * 0, "name no object"),
        (labels[None], r"array of int32 \(1, "),
        (labels[:5] * 0 + 1, r"array of int32 \(5,\)"),
    ):
        with pytest.raises(InputError, match=sentence):
            trim_objects(SCENE, wrong)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    formats.write(SCENE, folder / "scene.ply")
    labels = np.zeros(len(SCENE), np.int64)
    for number, mask in ROUGH.items():
        labels[mask] = number
    np.save(folder / "labels.npy", labels)
    return folder


def test_labels_on_the_command_line(files, tmp_path, capsys):
    command = ["trim", files / "scene.ply", "--labels", files / "labels.npy", "--up", 0, 0, 1, *SMALL]
    command += ["--background", "exact"]  # every Gaussian is in one of the files
    out = tmp_path / "out"
    assert run(*command, "--output", out) == 0
    assert "object 7:" in capsys.readouterr().out
    parts = [formats.read(out / f"{name}.ply") for name in ("object_3", "object_7", "background")]
    assert sum(map(len, parts)) == len(SCENE)
    report = json.loads((out / "report.json").read_text())
    assert [entry["id"] for entry in report["objects"]] == [3, 7]
    assert cv2.imread(str(out / "before_after.png")).shape[1] > 800
    assert run("info", out) == 0
    said = capsys.readouterr().out
    assert "results of a trim" in said and "object_3.ply" in said and "trim SCENE --labels" in said
    again = load_objects(out / "labels.npz", SCENE)
    assert {number: (again == number).sum() for number in (3, 7)} == {3: len(parts[0]), 7: len(parts[1])}
    assert run(*command, "--objects", 7, "--output", tmp_path / "one") == 0
    assert not (tmp_path / "one" / "object_3.ply").exists()
    assert run(*command, "--objects", 5, "--output", tmp_path / "none") == 2
    assert "no Gaussians of object 5" in capsys.readouterr().err
    assert run(*command, "--output", tmp_path / "x", "--grow", 1) == 2
    assert "leave SELECTION and marks out" in capsys.readouterr().err


def test_folders_differ_by_id(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["trim", files / "scene.ply", files / "labels.npy", "--up", 0, 0, 1, *SMALL, "--views", 3, "--quiet"]
    for number in (3, 7):
        assert run(*command, "--set", f"selection.object-id={number}") == 0
    assert sorted(path.name for path in (tmp_path / "trimmed").iterdir()) == [
        f"{files.name}-labels-{number}" for number in (3, 7)
    ]


def hollow():
    """The scene with dark Gaussians inside both balls, which only the balls hide."""
    inside = toy.gaussians(toy.CENTRE + 0.3 * np.random.default_rng(1).normal(size=(60, 3)), (0.05,) * 3, (0.05,) * 3)
    inner = [inside, inside.replace(means=inside.means + SHIFT)]
    return concatenate([SCENE, *inner]), np.arange(len(SCENE) + 120) >= len(SCENE)


def test_what_the_objects_hid_leaves_the_common_background():
    scene, dark = hollow()
    shells = {number: np.concatenate([truth, np.zeros(120, np.bool_)]) for number, truth in ((3, FIRST), (7, SECOND))}
    config = toy.small_config(evidence=EvidenceConfig(recover=False))
    clean = trim_objects(scene, shells, config=config)
    exact = trim_objects(scene, shells, config=replace(config, background="exact"))
    check_complementary(clean)
    assert not len(exact.discarded)
    assert dark[exact.rest.rows].sum() == 120
    assert dark[clean.discarded].sum() > 40 and dark[clean.discarded].mean() > 0.9
    for one, other in zip(clean.objects, exact.objects, strict=True):
        assert np.array_equal(one.source_index, other.source_index)


def test_the_order_of_the_objects_does_not_change_the_scene_without_them():
    config = toy.small_config(background="filled")
    backgrounds = []
    for ids in ((3, 7), (7, 3)):
        rest = trim_objects(SCENE, {number: ROUGH[number] for number in ids}, config=config).background
        backgrounds.append(rest.select(np.lexsort(rest.means.T)))
    assert np.array_equal(backgrounds[0].means, backgrounds[1].means)
    assert np.array_equal(backgrounds[0].opacity_logits, backgrounds[1].opacity_logits)
