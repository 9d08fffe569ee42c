"""`--config FILE`: a trim is made again, to the last byte, by the report of an earlier one."""

import json

import numpy as np
import pytest
from command_line import SMALL, run

RESULTS = ("object.ply", "background.ply")


def same(first, second, names=RESULTS):
    return all((first / name).read_bytes() == (second / name).read_bytes() for name in names)


def configuration(folder):
    return json.loads((folder / "report.json").read_text())["configuration"]


@pytest.mark.parametrize(
    "given", [["rough.npy"], ["rough.npy", "--exclude", "other.npy"], ["--sphere", 0, 0, 0.5, 0.6]]
)
def test_a_trim_is_made_again(given, ball, tmp_path):
    folder, scene, _ = ball
    np.save(tmp_path / "other.npy", scene.means[:, 0] > 1)
    paths = {"rough.npy": folder / "rough.npy", "other.npy": tmp_path / "other.npy"}
    words = [paths.get(word, word) for word in given]
    command = ["trim", folder / "scene.ply", *words, "--up", "z", "--preset", "paper", "--split.rule", "plane", *SMALL]
    assert run(*command, "--quiet", "--output", tmp_path / "first") in (0, 3)
    again = ["trim", "--config", tmp_path / "first" / "report.json", "--quiet", "--output"]
    assert run(*again, tmp_path / "second") in (0, 3)
    assert same(tmp_path / "first", tmp_path / "second")
    assert configuration(tmp_path / "second")["split"]["rule"] == "plane"
    assert run(*again, tmp_path / "third", "--views", 2, "--segmenter", "silhouette") in (0, 3)
    changed, before = configuration(tmp_path / "third"), configuration(tmp_path / "first")
    assert changed["plan"].pop("views") == 2 and before["plan"].pop("views") != 2
    assert changed == before


def test_several_objects_and_selections_of_marks_are_trimmed_again(ball, tmp_path):
    folder, scene, _ = ball
    np.save(tmp_path / "ids.npy", np.where(np.load(folder / "rough.npy"), 3, np.where(scene.means[:, 0] > 1, 5, 0)))
    several = ["trim", folder / "scene.ply", "--labels", tmp_path / "ids.npy", "--objects", 3, "--up", "z", *SMALL]
    assert run(*several, "--output", tmp_path / "first") == 0
    assert run("trim", "--config", tmp_path / "first" / "report.json", "--output", tmp_path / "again") == 0
    assert same(tmp_path / "first", tmp_path / "again", ("object_3.ply", "background.ply"))
    marks = ["--sphere", 0, 0, 0.5, 0.6, "--remove-sphere", 0, 0, 0.9, 0.2, "--output", tmp_path / "marked.npy"]
    selecting = ["select", folder / "scene.ply", *marks, "--up", "z", *SMALL]
    assert run(*selecting, "--trim", tmp_path / "selected") in (0, 3)
    assert run("trim", "--config", tmp_path / "selected" / "report.json", "--output", tmp_path / "more") in (0, 3)
    assert same(tmp_path / "selected", tmp_path / "more")


@pytest.mark.parametrize(
    ("content", "options", "said"),
    [
        ("[]", [], "holds no settings"),
        ("{}", ["a.ply"], "holds no settings"),
        ('{"configuration": {"plan": {"views": 0}}}', ["a.ply"], "configuration.plan.views is 0"),
        ('{"configuration": {"views": 1}}', ["a.ply"], "unknown field 'views'"),
        ('{"configuration": {}, "inputs": {"scene": 7}}', [], "inputs.scene is 7"),
        ('{"configuration": {}}', ["a.ply", "--preset", "paper"], "leave one out"),
        ("{", ["a.ply"], "cannot be read as JSON"),
    ],
)
def test_what_is_no_report_is_refused(content, options, said, tmp_path, capsys):
    (tmp_path / "report.json").write_text(content)
    assert run("trim", *options, "--config", tmp_path / "report.json", "--output", tmp_path / "out") == 2
    printed = capsys.readouterr().err
    assert said in printed and printed.count("\n") == 1
