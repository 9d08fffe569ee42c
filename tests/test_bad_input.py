"""Bad input ends in one sentence, exit code 2, and not a trace on disk."""

import numpy as np
import pytest
from command_line import SMALL, run, save_ball


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with the ball, and with scenes and selections that are none."""
    folder = tmp_path_factory.mktemp("ball")
    scene, _ = save_ball(folder)
    n, data = len(scene), (folder / "scene.ply").read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    (folder / "picture.ply").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(1000))
    (folder / "short.ply").write_bytes(data[:-100])
    (folder / "nan.ply").write_bytes(data[:end] + b"\xff" * (len(data) - end))
    (folder / "scene.obj").write_text("v 0 0 0\n")
    for name, array in {
        "empty": np.zeros(n, bool), "full": np.ones(n, bool), "short": np.ones(n - 1, bool),
        "scores": np.linspace(0, 1, n), "matrix": np.ones((3, n), bool), "pickled": np.array([{}], object),
    }.items():  # fmt: skip
        np.save(folder / f"{name}.npy", array, allow_pickle=True)
    return folder


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("nowhere.ply rough.npy", "There is no file"),
        ("picture.ply rough.npy", "not a PLY"),
        ("short.ply rough.npy", "truncated"),
        ("nan.ply rough.npy", "finite"),
        ("scene.obj rough.npy", "known endings"),
        ("scene.ply empty.npy", "selects none"),
        ("scene.ply full.npy", "selects all"),
        ("scene.ply short.npy", "entries"),
        ("scene.ply scores.npy", "--set selection.threshold"),
        ("scene.ply matrix.npy", "does not select from 1612 Gaussians"),
        ("scene.ply pickled.npy", "pickled.npy"),
        ("scene.ply rough.npy --format obj", "Unknown format 'obj'"),
        ("scene.ply rough.npy --sam nowhere", "nowhere"),
        ("scene.ply rough.npy --masks masks", "--cameras"),
        ("scene.ply rough.npy --cameras nowhere", "nowhere"),
        ("scene.ply rough.npy --set selection.object-id=3", "object"),
        ("scene.ply rough.npy --output rough.npy", "choose another"),
        ("scene.ply rough.npy --output rough.npy/below", "choose another"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_trace(words, said, files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    before = {path: path.stat().st_mtime_ns for path in files.rglob("*")}
    output = [] if "--output" in words else ["--output", "out"]
    assert run("trim", *words.split(), *output, *SMALL) == 2
    printed = capsys.readouterr().err
    assert said in printed and printed.endswith(".\n") and printed.count("\n") == 1
    assert {path: path.stat().st_mtime_ns for path in files.rglob("*")} == before
