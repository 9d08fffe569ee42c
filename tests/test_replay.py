"""`--config REPORT`: a trim is made again, to the last byte, by the command in the report of an earlier one."""

import json

import numpy as np
import pytest
from command_line import SMALL, run, within
from test_select_command import middle_of

RESULTS = ("object.ply", "background.ply")


def same(first, second, names=RESULTS):
    return all((first / name).read_bytes() == (second / name).read_bytes() for name in names)


def report_of(folder):
    return json.loads((folder / "report.json").read_text())


@pytest.mark.parametrize("given", [["rough.npy"], ["rough.npy", "--exclude", "other.npy"], ["--add", "rough.npy"]])
def test_a_trim_is_made_again(given, ball, tmp_path):
    folder, scene, _ = ball
    np.save(tmp_path / "other.npy", scene.means[:, 0] > 1)
    paths = {"rough.npy": folder / "rough.npy", "other.npy": tmp_path / "other.npy"}
    words = [paths.get(word, word) for word in given]
    command = ["trim", folder / "scene.ply", *words, "--up", "z", "--preset", "paper", "--set", "split.rule=plane"]
    assert run(*command, *SMALL, "--quiet", "--output", tmp_path / "first") in (0, 3)
    again = ["trim", "--config", tmp_path / "first" / "report.json", "--quiet", "--output"]
    assert run(*again, tmp_path / "second") in (0, 3)
    assert same(tmp_path / "first", tmp_path / "second")
    assert report_of(tmp_path / "second")["command"] == report_of(tmp_path / "first")["command"]
    assert run(*again, tmp_path / "third", "--views", 2) in (0, 3)
    changed, before = (report_of(tmp_path / name)["configuration"] for name in ("third", "first"))
    assert changed["plan"].pop("views") == 2 and before["plan"].pop("views") != 2
    assert changed == before and changed["split"]["rule"] == "plane"


def test_several_objects_and_selections_of_marks_are_trimmed_again(ball, tmp_path):
    folder, scene, _ = ball
    np.save(tmp_path / "ids.npy", np.where(np.load(folder / "rough.npy"), 3, np.where(scene.means[:, 0] > 1, 5, 0)))
    several = ["trim", folder / "scene.ply", "--labels", tmp_path / "ids.npy", "--objects", 3, "--up", "z", *SMALL]
    assert run(*several, "--output", tmp_path / "first") == 0
    report = tmp_path / "first" / "report.json"
    assert run("trim", "--config", report, "--output", tmp_path / "again") == 0
    assert same(tmp_path / "first", tmp_path / "again", ("object_3.ply", "background.ply"))
    other = ["trim", folder / "scene.ply", folder / "rough.npy", "--config", report]
    assert run(*other, "--output", tmp_path / "one") == 0
    assert (tmp_path / "one" / "object.ply").is_file()
    top = within(tmp_path / "a.npy", scene, (0, 0, 1.9), 0.2)
    marks = ["--view", "0", "--click", *middle_of(folder), "--subtract", top]
    selecting = ["select", folder / "scene.ply", "--cameras", folder / "cameras.json", *marks, *SMALL]
    assert run(*selecting, "--output", tmp_path / "marked.npy", "--trim", tmp_path / "selected") in (0, 3)
    assert run("trim", "--config", tmp_path / "selected" / "report.json", "--output", tmp_path / "more") in (0, 3)
    assert same(tmp_path / "selected", tmp_path / "more")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("[]", "holds no command"),
        ('{"configuration": {"up": [0, 0, 1]}, "inputs": 5}', "an earlier release wrote"),
        ('{"command": "trim a.ply"}', "holds no command"),
        ('{"command": []}', "holds no command"),
        ('{"command": ["trim", 7]}', "holds no command"),
        ('{"command": ["trim", "\\ud800"]}', "holds no command"),
        ('{"command": ["trim", "a\\u0000.ply"]}', "holds no command"),
        ('{"segmenter": [], "inputs": {"scene": "s.ply", "renderer": [1]}}', "holds no command"),
        ('{"command": ["trim"]}', "'trim' needs SCENE"),
        ('{"command": ["rm", "-r", "/"]}', "is of another command; repeat gaussian-trimmer rm -r /"),
        ('{"command": ["objects", "a.ply", "--merge", "1+2"]}', "repeat gaussian-trimmer objects a.ply --merge 1+2"),
        ('{"command": ["trim", "a.ply", "--set", "plan.views=0"]}', "plan.views is 0"),
        ('{"command": ["trim", "a.ply", "--execute", "x"]}', "--execute is not an option"),
        ('{"command": ["trim", "nowhere.ply", "--output", "mine", "--overwrite"]}', "There is no file 'nowhere.ply'"),
        ("{", "cannot be read as JSON"),
    ],
)
def test_what_is_no_report_is_refused(content, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "report.json").write_text(content)
    assert run("trim", "--config", "report.json", "--output", "out") == 2
    printed = capsys.readouterr().err
    assert said in printed and printed.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]
