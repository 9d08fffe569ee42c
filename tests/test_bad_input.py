"""Bad input ends in one sentence, exit code 2, and not a trace on disk."""

import numpy as np
import pytest
from command_line import SMALL, run, save_ball


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    scene, _ = save_ball(folder)
    return folder, scene


def trim_fails(scene, *rest, output, capsys):
    """Run `trim`, check that it fails as it should, and return what it said."""
    before = sorted(output.parent.iterdir()) if output.parent.is_dir() else None
    assert run("trim", scene, *rest, "--output", output, *SMALL) == 2
    printed = capsys.readouterr().err
    assert printed.endswith(".\n")
    assert printed.count("\n") == 1
    assert (sorted(output.parent.iterdir()) if output.parent.is_dir() else None) == before
    return printed


def with_nan(data):
    end = data.index(b"end_header\n") + len(b"end_header\n")
    return data[:end] + np.float32(np.nan).tobytes() + data[end + 4 :]


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (None, "There is no file"),
        (lambda data: b"\x89PNG\r\n\x1a\n" + bytes(1000), "not a PLY"),
        (lambda data: data[:-100], "truncated"),
        (with_nan, "finite"),
    ],
)
def test_damaged_scenes(damaged, said, ball, tmp_path, capsys):
    folder, _ = ball
    scene = tmp_path / "damaged.ply"
    if damaged:
        scene.write_bytes(damaged((folder / "scene.ply").read_bytes()))
    assert said in trim_fails(scene, folder / "rough.npy", output=tmp_path / "out", capsys=capsys)


def test_unknown_endings(ball, tmp_path, capsys):
    folder, _ = ball
    (tmp_path / "scene.obj").write_text("v 0 0 0\n")
    said = trim_fails(tmp_path / "scene.obj", folder / "rough.npy", output=tmp_path / "out", capsys=capsys)
    assert "known endings" in said
    said = trim_fails(
        folder / "scene.ply", folder / "rough.npy", "--format", "obj", output=tmp_path / "out", capsys=capsys
    )
    assert "Unknown format 'obj'" in said


@pytest.mark.parametrize(
    ("name", "make", "said"),
    [
        ("empty.npy", lambda n: np.zeros(n, bool), "selects none"),
        ("full.npy", lambda n: np.ones(n, bool), "selects all"),
        ("short.npy", lambda n: np.ones(n - 1, bool), "entries"),
        ("scores.npy", lambda n: np.linspace(0, 1, n), "--set selection.threshold"),
        ("matrix.npy", lambda n: np.ones((3, n), bool), "is not a selection"),
        ("beyond.npy", lambda n: np.array([1, 2, n]), "row numbers 0 to"),
        ("pickled.npy", lambda n: np.array([{}], object), "pickled.npy"),
    ],
)
def test_wrong_selections(name, make, said, ball, tmp_path, capsys):
    folder, scene = ball
    np.save(tmp_path / name, make(len(scene)), allow_pickle=True)
    assert said in trim_fails(folder / "scene.ply", tmp_path / name, output=tmp_path / "out", capsys=capsys)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--sam", "nowhere"], "nowhere"),
        (["--masks", "masks"], "--cameras"),
        (["--cameras", "nowhere"], "nowhere"),
        (["--set", "selection.object-id=3"], "object"),
    ],
)
def test_wrong_options(options, said, ball, tmp_path, capsys):
    folder, _ = ball
    scene, rough = folder / "scene.ply", folder / "rough.npy"
    assert said in trim_fails(scene, rough, *options, output=tmp_path / "out", capsys=capsys)


def test_output_that_cannot_be_written(ball, tmp_path, capsys):
    folder, _ = ball
    (tmp_path / "file").write_text("in the way")
    for output in (tmp_path / "file", tmp_path / "file" / "below"):
        said = trim_fails(folder / "scene.ply", folder / "rough.npy", output=output, capsys=capsys)
        assert "choose another" in said
    assert (tmp_path / "file").read_text() == "in the way"
