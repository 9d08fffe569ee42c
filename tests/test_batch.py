"""Batches in one process: what is made, made again and told, and whom a failure costs."""

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import toy
from batch_runs import QUICK, contents, fresh_of, inline, parts, save_scenes, write_manifest
from command_line import run

import gaussian_trimmer as gt
from gaussian_trimmer.commands import batch as command
from gaussian_trimmer.io.writing import write_table
from gaussian_trimmer.selecting.marks import Sphere

HEADER = "scene,selection,name,up,options"


@pytest.fixture(autouse=True, scope="module")
def _inline():
    with pytest.MonkeyPatch.context() as patch, toy.one_thread():
        patch.setattr(command, "on_processes", inline)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two scenes with two selections each, `manifest.csv`, and in `out` what a batch makes of it."""
    folder = tmp_path_factory.mktemp("batch")
    assert run("batch", write_manifest(folder, save_scenes(folder)), "--output", folder / "out", "--quiet") == 0
    return folder


@pytest.fixture
def copy(folder, tmp_path, monkeypatch):
    """Everything of `folder` in a folder that a test may change; paths in its manifest are the same."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(folder, tmp_path / "copy")
    assert run("batch", tmp_path / "copy" / "manifest.csv", "--output", tmp_path / "copy" / "out", "--quiet") == 0
    return tmp_path / "copy"


def batch(folder, capsys, *rows, output="out", code=0, more=()):
    """Rows of the summary by name, of the manifest or of other rows; and how many were made now."""
    if rows:
        (folder / "rows.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    capsys.readouterr()
    manifest = folder / ("rows.csv" if rows else "manifest.csv")
    assert run("batch", manifest, "--output", folder / output, *more) == code
    with (folder / output / "summary.csv").open(newline="") as file:
        return {row["name"]: row for row in csv.DictReader(file)}, fresh_of(capsys.readouterr().out)


def save_marked(folder):
    """A selection of s1.ply whose marks have removed something, as marked.npy and marked.json."""
    marks = [Sphere((0, 0, 1), 1.1), Sphere((0, -1, 1), 0.6, effect="remove")]
    gt.select(gt.read(folder / "s1.ply"), marks, up=toy.UP).save(folder / "marked.npy")


@pytest.mark.parametrize(
    ("name", "more"),
    [("s1-1.npy", "--html --for three --no-write-background"), ("marked.json", "")],
)
def test_a_batch_of_one_is_the_command(folder, tmp_path, capsys, name, more):
    """Byte for byte, also where marks have removed something; and its report trims the same again."""
    shutil.copy(folder / "s1.ply", tmp_path)
    shutil.copy(folder / "s1-1.npy", tmp_path)
    save_marked(tmp_path)
    rows, _ = batch(tmp_path, capsys, f"s1.ply,{name},one,z,{QUICK} {more}", output="new")
    arguments = ["--up", "z", *f"{QUICK} {more}".split(), "--quiet"]
    assert run("trim", tmp_path / "s1.ply", tmp_path / name, *arguments, "--output", tmp_path / "b/items/one") == 0
    again = ["--config", tmp_path / "new/items/one/report.json", "--quiet", "--output", tmp_path / "c/items/one"]
    assert run("trim", *again, *(["--html"] if more else [])) == 0
    for other in ("b", "c"):
        made, expected = contents(tmp_path / "new"), contents(tmp_path / other)
        made.pop("one/report.html", None), expected.pop("one/report.html", None)
        assert made == expected
    files = {path.name for path in (tmp_path / "new/items/one").iterdir()}
    assert ("report.html" in files, "background.ply" in files) == (bool(more), not more)
    (entry,) = json.loads((tmp_path / "new/items/one/report.json").read_text())["objects"]
    row = rows["one"]
    assert row["state"] == "done" and float(row["seconds"]) > 0 and int(row["selected"]) == entry["counts"]["selected"]
    assert [float(row[name]) for name in "xyz"] == pytest.approx(entry["bounds"]["centre"], abs=1e-5)
    size = [float(row[name]) / 2 for name in ("length", "width", "height")]
    assert size == pytest.approx(entry["bounds"]["half_extents"], abs=1e-5)
    turn = gt.gaussians.rotation_matrices(np.array([[float(row[f"q{name}"]) for name in "wxyz"]]))[0]
    assert pytest.approx(np.array(entry["bounds"]["axes"]), abs=1e-4) == turn.T


def test_only_what_has_changed_is_made_again(copy, capsys):
    rows, fresh = batch(copy, capsys)
    assert (fresh, list(rows)) == (0, ["s0-0", "s0-1", "s1-0", "s1-1"])
    selection = np.load(copy / "s0-1.npy")
    np.save(copy / "s0-1.npy", selection & (np.arange(len(selection)) % 50 > 0))
    (copy / "out" / "items" / "s1-0" / "object.ply").unlink()
    again, fresh = batch(copy, capsys)
    assert fresh == 2
    assert again["s1-1"] == rows["s1-1"] and again["s0-1"] != rows["s0-1"]
    os.utime(copy / "s1.ply")
    assert batch(copy, capsys)[1] == 2
    assert batch(copy, capsys, more=["--options", "--refine off --background exact"])[1] == 4
    save_marked(copy)
    row = f"s1.ply,marked.json,one,z,{QUICK}"
    assert [batch(copy, capsys, row, output="new")[1] for _ in range(2)] == [1, 0]
    gt.select(gt.read(copy / "s1.ply"), [Sphere((0, 0, 1), 1.2)], up=toy.UP).save(copy / "marked.npy")
    assert batch(copy, capsys, row, output="new")[1] == 1


@pytest.mark.parametrize(
    ("file", "text"),
    [("manifest.json", "{}"), ("manifest.json", '{"files":[]}'), ("report.json", "[1]"), ("report.json", "{}"),
     ("manifest.json", r'{"program": "gaussian-trimmer", "kind": "trim", "files": {"a\u0000": 1}}')],
)  # fmt: skip
def test_damaged_results_are_not_whole(folder, tmp_path, capsys, file, text):
    """They are nobody's to replace; in the summary of another shard they are left."""
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    rows = [f"s0.ply,s0-{k}.npy,{name},z,{QUICK}" for k, name in enumerate("ab")]
    batch(tmp_path, capsys, *rows, output="new")
    (tmp_path / "new" / "items" / "a" / file).write_text(text)
    found, _ = batch(tmp_path, capsys, *rows, output="new", more=["--shard", "2/2"])
    assert [found[name]["state"] for name in "ab"] == ["left", "done"]
    found, _ = batch(tmp_path, capsys, *rows, output="new", code=2)
    assert "in the way" in found["a"]["message"]


def test_failures_cost_their_items_alone_and_are_tried_again(copy, capsys):
    data = (copy / "s1.ply").read_bytes()
    (copy / "s1.ply").write_bytes(data[:-40])
    rows = ["s0.ply,s0.ply,whole,z,", "s1.ply,s1-0.npy,cut,z,", f"s0.ply,s0-0.npy,good,z,{QUICK}"]
    found, fresh = batch(copy, capsys, *rows, output="new", code=2)
    assert [row["state"] for row in found.values()] == ["failed", "failed", "done"] and fresh == 1
    assert "not a part of the scene" in found["whole"]["message"]
    (copy / "s1.ply").write_bytes(data)
    found, fresh = batch(copy, capsys, *rows[1:], output="new")
    assert (found["cut"]["state"], fresh) == ("done", 1)


def test_a_defect_is_told_with_its_place(copy, capsys, monkeypatch):
    monkeypatch.setattr(command.trim, "run", lambda *given: 1 / 0)
    found, _ = batch(copy, capsys, "s0.ply,s0-0.npy,a,z,", output="new", code=2)
    assert "A defect of the program: ZeroDivisionError: division by zero" in found["a"]["message"]
    assert f"({Path(__file__)}, line" in found["a"]["message"]


def test_all_files_are_looked_at_before_the_first_row_begins(folder, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe.npy")
    scene = folder / "s0.ply"
    rows = [f"{scene},{folder / 's0-0.npy'},a,z,", f"{scene},gone.npy,b,z,", f"{scene},/dev/zero,c,z,"]
    rows += [f"{scene},pipe.npy,d,z,", f"gone.ply,{folder / 's0-0.npy'},e,z,"]
    rows += [f"{scene},{folder / 's0-0.npy'},f,z,--masks nowhere"]
    (tmp_path / "rows.csv").write_text("\n".join([HEADER, *rows]))
    assert run("batch", tmp_path / "rows.csv", "--output", tmp_path / "out") == 2
    told = capsys.readouterr().err
    assert [line for line in range(2, 9) if f"line {line}: There is no file" in told] == [3, 4, 5, 6, 7]
    assert not (tmp_path / "out").exists()


def test_the_command(copy, capsys):
    """Its exit codes, what it prints, and its JSON."""
    manifest = copy / "manifest.csv"
    manifest.write_text(manifest.read_text() + "s0.ply,s0.ply,=whole,z,\n".replace("=", ""))
    assert run("batch", manifest, "--output", copy / "out") == 2
    told = capsys.readouterr()
    assert told.out.splitlines()[0].startswith("failed: whole: ") and "4 of 5 done (4 earlier), 1 failed" in told.out
    assert "1 of 5 items failed, the first is whole. All are in" in told.err
    assert run("batch", manifest, "--output", copy / "out", "--json") == 2
    told = capsys.readouterr()
    assert "the first is whole, since: " in told.err
    states = {row["name"]: row["state"] for row in json.loads(told.out)["items"]}
    assert states == {**dict.fromkeys(["s0-0", "s0-1", "s1-0", "s1-1"], "done"), "whole": "failed"}
    assert batch(copy, capsys, f"s0.ply,s0-0.npy,x,z,{QUICK}")[1] == 1


@pytest.mark.parametrize("cell", ['=HYPERLINK("x")', "@sum", "-1+1", "\tx"])
def test_cells_of_the_table_are_no_formulas(cell, tmp_path):
    write_table([{"name": cell, "x": -1.5}], tmp_path / "table.csv", for_people=True)
    (row,) = csv.DictReader((tmp_path / "table.csv").open(newline=""))
    assert row == {"name": f"'{cell}", "x": "-1.5"}


def test_nothing_stays_of_an_item_that_was_begun_and_not_finished(tmp_path):
    begun = "import os, sys, pathlib; from gaussian_trimmer.io.folders import atomic_folder\n"
    begun += "with atomic_folder(pathlib.Path(sys.argv[1]), 'trim'): os._exit(9)"
    (tmp_path / "items" / "c").mkdir(parents=True)
    item = tmp_path / "items" / "a" / "b"
    assert subprocess.run([sys.executable, "-c", begun, item], check=False).returncode == 9 and parts(item)
    command._remove_rest(item, tmp_path)
    assert [path.name for path in (tmp_path / "items").iterdir()] == ["c"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--engine", "slurm"], "engine"),
        (["--workers", 0], "workers"),
        (["--shard", "4/3"], "shard is 4/3"),
        (["--address", "auto"], "that of a cluster"),
        (["--engine", "ray", "--address", "auto", "--workers", 2], "leave the workers out"),
    ],
)
def test_options_that_are_not_possible(folder, tmp_path, capsys, options, said):
    assert run("batch", folder / "manifest.csv", "--output", tmp_path / "out", *options) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
