"""The demonstration: the sample scene is complete, and trimming it gives a good lighthouse."""

import json

import numpy as np
import pytest
from command_line import run

from gaussian_trimmer import formats, sample
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.masks.mask_files import find_masks


def test_sample_is_complete_and_small():
    scene, selection = formats.read(sample.SCENE), np.load(sample.SELECTION, allow_pickle=False)
    assert selection.shape == (len(scene),)
    assert 0 < np.count_nonzero(selection) < 0.1 * len(scene)
    assert len(find_masks(read_camera_set(sample.CAMERAS).cameras, sample.MASKS)) == 10
    folder = sample.SCENE.parent
    assert "CC0" in (folder / "LICENSE.txt").read_text()
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < 8_000_000


@pytest.mark.slow
def test_demo_trims_the_lighthouse_and_says_where_to_look(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "trimmed" / "demo"
    with atomic_folder(folder, "trim") as earlier:
        (earlier / "object.ply").write_text("of an earlier run")
        (earlier / "object.splat").write_text("of an earlier run")
    assert run("demo") == 0
    assert not (folder / "object.splat").exists()
    assert "trimmed/demo/report.html" in capsys.readouterr().out.replace("\\", "/")
    assert (folder / "report.html").exists()
    report = json.loads((folder / "report.json").read_text())
    (entry,) = report["objects"]
    assert entry["refused"] is None
    assert all(view["accepted"] for view in entry["views"])
    # The table around the foot goes, and not much else.
    counts = entry["counts"]
    assert 50 < counts["removed"] + counts["discarded"] < 250
    assert 2100 < counts["object"] == len(formats.read(folder / "object.ply")) < 2413
