"""Batches in one process: what is made, made again, told and recorded, and whom a failure costs."""

import csv
import json
import os
import shutil
from concurrent.futures import Future
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import toy
from batch_runs import QUICK, InlineProcesses, contents, save_scenes, write_manifest

import gaussian_trimmer as gt
from gaussian_trimmer.batch import running
from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.memory import PROCESS_BYTES, scene_need
from gaussian_trimmer.batch.store import Store
from gaussian_trimmer.batch.summary import as_csv, as_html, look_first, write_summaries
from gaussian_trimmer.batch.trimming import trim_item
from gaussian_trimmer.cli import main
from gaussian_trimmer.commands import batch as command
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.errors import FolderInUseError, InputError
from gaussian_trimmer.masks.mask_files import MaskFilesConfig, MaskFilesSegmenter
from gaussian_trimmer.selecting.marks import Sphere
from gaussian_trimmer.trimming.config import PlanConfig


@pytest.fixture(autouse=True)
def inline(monkeypatch):
    monkeypatch.setattr(running, "LocalProcesses", InlineProcesses)
    with toy.one_thread():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two scenes with two selections each, `manifest.csv`, and in `out` what a batch makes of it."""
    folder = tmp_path_factory.mktemp("batch")
    manifest = write_manifest(folder, save_scenes(folder))
    with pytest.MonkeyPatch.context() as patch, toy.one_thread():
        patch.setattr(running, "LocalProcesses", InlineProcesses)
        gt.batch.run(gt.batch.read_manifest(manifest), folder / "out")
    return folder


@pytest.fixture
def copy(folder, tmp_path):
    """Everything of `folder` in a folder that a test may change."""
    return shutil.copytree(folder, tmp_path / "copy")


def batch(folder, *rows, output="out", no_background=False, **options):
    """Outcomes by name, of the manifest or of other rows."""
    if rows:
        (folder / "rows.csv").write_text("\n".join(["scene,selection,name,up,options", *rows]) + "\n")
    items = gt.batch.read_manifest(folder / ("rows.csv" if rows else "manifest.csv"))
    items = [replace(item, background=not no_background) for item in items]
    return {outcome.item.name: outcome for outcome in gt.batch.run(items, folder / output, **options)}


def fresh(outcomes):
    return [name for name, outcome in outcomes.items() if outcome.fresh]


@pytest.mark.parametrize(
    ("name", "more"),
    [("s1-1.npy", ""), ("marked.npy", ""), ("marked.json", ""), ("s1-1.npy", " --origin foot --html"),
     ("s1-1.npy", " --for three --scale 2")],
)  # fmt: skip
def test_a_batch_of_one_is_the_command(copy, name, more):
    """Byte for byte, also where marks have removed something."""
    save_marked(copy)
    (found,) = batch(copy, f"s1.ply,{name},one,z,{QUICK}{more}", output="new").values()
    arguments = ["--up", "z", *f"{QUICK}{more}".split(), "--output", str(copy / "one"), "--quiet"]
    assert main(["trim", str(copy / "s1.ply"), str(copy / name), *arguments]) == 0
    own = {"report.json", "report.html", "manifest.json", "item.json", "selection.json"}
    ours = {path: data for path, data in contents(copy / "new").items() if path.rpartition("/")[2] not in own}
    theirs = {
        f"one/{path.relative_to(copy / 'one').as_posix()}": path.read_bytes()
        for path in (copy / "one").rglob("*")
        if path.is_file() and path.name not in own
    }
    assert found.state == "done"
    assert ours == theirs
    assert (copy / "new" / "items" / "one" / "report.html").is_file() == ("--html" in more)


def test_an_item_is_made_again_when_it_is_to_be_placed(copy):
    row = f"s0.ply,s0-0.npy,one,z,{QUICK}"
    batch(copy, row, output="new", no_background=True)
    placed = batch(copy, f"{row} --origin foot --html", output="new", no_background=True)["one"]
    files = {path.name for path in (copy / "new" / "items" / "one").iterdir()}
    assert placed.fresh and {"object_placed.ply", "object_hull.obj", "poses.json", "report.html"} <= files
    assert "background_placed.ply" not in files
    assert batch(copy, row, output="new", no_background=True)["one"].fresh
    assert not (copy / "new" / "items" / "one" / "poses.json").exists()


def save_marked(folder):
    """A selection of s1.ply whose marks have removed something, as marked.npy and marked.json."""
    marks = [Sphere((0, 0, 1), 1.1), Sphere((0, -1, 1), 0.6, effect="remove")]
    gt.select(gt.read(folder / "s1.ply"), marks, up=toy.UP).save(folder / "marked.npy")


def test_seconds_are_kept_and_marks_are_inputs(copy):
    save_marked(copy)
    row = f"s1.ply,marked.npy,one,z,{QUICK}"
    first, again = (batch(copy, row, output="new")["one"] for _ in range(2))
    assert (again.fresh, again.seconds) == (False, round(first.seconds, 3))
    assert again.seconds > 0
    (copy / "marked.json").unlink()
    assert batch(copy, row, output="new")["one"].fresh


@pytest.mark.parametrize(
    ("file", "text"),
    [("items/a/manifest.json", "{}"), ("items/a/manifest.json", '{"files":[]}'), ("items/a/item.json", '{"views": 3}'),
     *(("items/a/manifest.json", f'{{"program": "gaussian-trimmer", "kind": "trim", "files": {{"{name}": 1}}}}')
       for name in (r"a\u0000", r"\ud800", "a/" * 3000)),
     ("items/a/item.json", "[1]"), ("records/a.json", "{}"), ("records/a.json", '{"seconds": "x"}')],
)  # fmt: skip
def test_damaged_records_are_none(copy, file, text):
    """Of an item of this run, and of another shard's, which the summary looks up."""
    row = f"s0.ply,s0-0.npy,a,z,{QUICK}"
    batch(copy, row, output="new")
    (copy / "new" / file).write_text(text)
    store, items = Store(copy / "new"), gt.batch.read_manifest(copy / "rows.csv")
    write_summaries(store, items, [])
    found = batch(copy, row, output="new")["a"]  # a result that was changed is nobody's to replace
    assert found.state == "done" if file.startswith("records") else "in the way" in found.message


def test_only_what_has_changed_is_made_again(copy):
    told, statuses = [], []
    again = batch(copy, on_result=told.append, on_status=statuses.append)
    assert (fresh(again), [outcome.item.name for outcome in told]) == ([], ["s0-0", "s0-1", "s1-0", "s1-1"])
    assert (statuses[-1].done, statuses[-1].found, statuses[-1].total) == (4, 4, 4)
    os.utime(copy / "s1.ply")
    selection = np.load(copy / "s0-1.npy")
    np.save(copy / "s0-1.npy", selection & (np.arange(len(selection)) % 50 > 0))
    (copy / "out" / "items" / "s1-0" / "object.ply").unlink()
    assert fresh(batch(copy)) == ["s0-1", "s1-0"]
    assert batch(copy)["s1-1"].counts == again["s1-1"].counts


def test_failures_cost_their_items_alone_and_are_tried_again_when_mended(copy):
    data = (copy / "s1.ply").read_bytes()
    (copy / "s1.ply").write_bytes(data[:-40])
    os.mkfifo(copy / "pipe.npy")
    rows = ["gone.ply,s0-0.npy,scene,z,", "s0.ply,gone.npy,gone,z,", "s0.ply,/dev/zero,device,z,"]
    rows += ["s0.ply,pipe.npy,pipe,z,", "s0.ply,s0.ply,whole,z,", "s1.ply,s1-0.npy,cut,z,"]
    rows += [f"s0.ply,s0-0.npy,good,z,{QUICK}"]
    found = batch(copy, *rows, output="new")
    assert [name for name, outcome in found.items() if outcome.state == "done"] == ["good"]
    assert all("There is no file" in found[name].message for name in ("gone", "device", "pipe"))
    assert "not a part of the scene" in found["whole"].message
    again = batch(copy, *rows, output="new")
    assert not again["cut"].fresh
    assert batch(copy, *rows, output="new", retry_failed=True)["cut"].fresh
    (copy / "s1.ply").write_bytes(data)
    found = batch(copy, *rows, output="new")
    assert (found["cut"].state, found["good"].fresh) == ("done", False)
    assert json.loads((copy / "new" / "records" / "cut.json").read_text())["message"] == ""


def test_a_batch_stops_when_nothing_can_be_written(copy, monkeypatch):
    def refuse(store, item, inputs):
        raise OSError(28, "No space left on device")

    told = []
    monkeypatch.setattr(Store, "result_folder", refuse)
    with pytest.raises(InputError, match=r"3 items in a row could not be written.*No space left"):
        batch(copy, output="new", on_result=told.append)
    assert [outcome.state for outcome in told] == ["failed"] * 3 + ["left"]
    monkeypatch.undo()
    monkeypatch.setattr(running, "LocalProcesses", InlineProcesses)
    assert len(fresh(batch(copy, output="new"))) == 4


def test_what_a_lost_cluster_had_finished_is_done_and_the_rest_is_left(copy, monkeypatch):
    class Cluster(InlineProcesses):
        def submit(self, item):
            future = super().submit(item)
            if item.name == "s0-1":
                (future := Future()).set_exception(self.lost())
            return future

        def check(self):
            raise InputError("The cluster is gone.")

    told = []
    monkeypatch.setattr(running, "LocalProcesses", Cluster)
    with pytest.raises(InputError, match=r"cluster is gone"):
        batch(copy, output="new", on_result=told.append)
    assert [outcome.state for outcome in told] == ["done", "done", "left", "left"]
    monkeypatch.setattr(running, "LocalProcesses", InlineProcesses)
    assert fresh(batch(copy, output="new")) == ["s1-0", "s1-1"]


def test_nothing_stays_of_an_item_that_was_begun_and_not_finished(copy):
    part = copy / "new" / "items" / "a" / "b" / ".gaussian-trimmer.part" / "new"
    part.mkdir(parents=True)
    (part / "object.ply").write_bytes(b"half")
    (copy / "new" / "items" / "c").mkdir()
    Store(copy / "new").clean("a/b")
    assert [path.name for path in (copy / "new" / "items").iterdir()] == ["c"]


def test_what_another_run_is_writing_comes_last(copy, monkeypatch):
    plain, asked = Store.result_folder, []

    def busy_once(store, item, inputs):
        asked.append(item.name)
        if asked == ["s0-0"]:
            raise FolderInUseError("busy")
        return plain(store, item, inputs)

    monkeypatch.setattr(Store, "result_folder", busy_once)
    assert {outcome.state for outcome in batch(copy, output="new").values()} == {"done"}
    assert asked == ["s0-0", "s0-1", "s0-0", "s1-0", "s1-1"]


def test_a_scene_may_be_the_folder_of_a_training(copy):
    place = copy / "model" / "point_cloud" / "iteration_7"
    place.mkdir(parents=True)
    shutil.copy(copy / "s0.ply", place / "point_cloud.ply")
    found = batch(copy, f"model,s0-0.npy,,z,{QUICK}", output="new")
    assert list(found) == ["model/s0-0"]
    ours, expected = contents(copy / "new"), contents(copy / "out")
    assert ours["model/s0-0/object.ply"] == expected["s0-0/object.ply"]


def test_what_a_trim_warns_of_is_told_of_its_item(copy):
    first, again = (batch(copy, f"s0.ply,,all,z,{QUICK}", output="new")["all"] for _ in range(2))
    assert first.warnings == again.warnings and not again.fresh
    assert "The object is the whole file" in first.told and look_first(again) > 1
    (row,) = csv.DictReader(as_csv([again]).splitlines())
    assert row["message"] == first.told


def test_views_that_cannot_be_had_are_refused(tmp_path, monkeypatch):
    scene, _ = toy.ball_on_floor()
    monkeypatch.setattr(MaskFilesSegmenter, "own_cameras", lambda segmenter, cameras: [])
    config, options = gt.TrimConfig(plan=PlanConfig(views=7)), MaskFilesConfig(tmp_path)
    item = Item("a.ply", segmenter="mask-files", segmenter_options=options, config=config)
    with pytest.raises(InputError, match="7 virtual views cannot be had"):
        trim_item(scene, item, None)


def test_the_command(copy, capsys):
    """Its exit codes and its summaries."""
    manifest, arguments = copy / "manifest.csv", ["--output", str(copy / "new"), "--no-background"]
    rows = manifest.read_text()
    manifest.write_text(rows + "gone.ply,s0-0.npy,gone,z,\n")
    assert main(["batch", str(manifest), *arguments]) == 2
    told = capsys.readouterr()
    assert "failed: gone: There is no file" in told.out
    assert "1 of 5 items failed, the first is gone. All are in" in told.err
    with (copy / "new" / "summary.csv").open() as file:
        table = [(row["name"], row["state"]) for row in csv.DictReader(file)]
    assert table[0] == ("gone", "failed")
    assert sorted(table[1:]) == [(f"s{s}-{k}", "done") for s in (0, 1) for k in (0, 1)]
    assert (copy / "new" / "records" / "gone.json").exists()
    assert main(["batch", str(manifest), *arguments, "--json"]) == 2
    told = capsys.readouterr()
    assert "the first is gone, since: There is no file" in told.err
    states = {row["name"]: row["state"] for row in json.loads(told.out)["items"]}
    assert states == dict(table)
    manifest.write_text(rows)
    assert main(["batch", str(manifest), *arguments]) == 0
    assert "4 of 4 done (4 earlier)" in capsys.readouterr().out
    left_out = ("item.json", "manifest.json", "background.ply")
    ours, expected = (
        {path: data for path, data in contents(copy / name).items() if not path.endswith(left_out)}
        for name in ("new", "out")
    )
    assert ours == expected
    assert not list((copy / "new").rglob("background.ply"))


def test_progress(capsys):
    """A line for each item without a terminal too."""
    shown = command._Progress(open_console(quiet=False), None, 10)
    shown.show_outcome(outcome("x", state="failed", message="it is\x1b[31m broken"))
    shown.show_outcome(outcome("y", seconds=1.25))
    shown.show_outcome(outcome("z", fresh=False))
    shown.show_status(gt.batch.Status(total=10, done=4, failed=1, found=1))
    shown.show_status(gt.batch.Status(total=10, done=4, failed=1, found=1))
    shown.show_outcome(outcome("v", state="failed", message="it is, too"))
    shown.show_status(gt.batch.Status(total=10, done=4, failed=2, found=1))
    failed, done, line, *later = capsys.readouterr().out.splitlines()
    assert "x: it is\\x1b[31m broken" in failed
    assert "y, 1.2 s" in done
    assert "5 of 10 items, 1 failed, 1 from before" in line
    assert later[0] == "failed: v: it is, too" and later[1].startswith("6 of 10 items, 2 failed") and len(later) == 2


def test_cells_of_the_table_are_no_formulas():
    made = gt.batch.Outcome(Item('=HYPERLINK("x").ply', "@sum.npy", "a"), "failed", "-1+1")
    (row,) = csv.DictReader(as_csv([made]).splitlines())
    assert [row[name][0] for name in ("scene", "selection", "message")] == ["'"] * 3


def outcome(name, **changes):
    made = gt.batch.Outcome(Item("a.ply", name=name), "done", counts={"selected": 100}, views=(5, 5))
    return gt.batch.Outcome(**{**vars(made), **changes})


def test_the_worst_come_first():
    ordered = [
        outcome("a", state="failed", message="<broken>"),
        outcome("b", refused="too little"),
        outcome("w", warnings=("It may be wrong.",)),
        outcome("c", views=(2, 5)),
        outcome("d", counts={"selected": 100, "removed": 30}, warnings=("A side.",), shrunk_side="A side"),
        outcome("e", counts={"selected": 9, "kept": 6, "cut": 3, "removed": 0, "added": 2, "object": 15}),
    ]
    doubts = [look_first(entry) for entry in ordered]
    assert doubts == sorted(set(doubts), reverse=True)
    page = as_html(ordered)
    assert "6 items: 5 done, 1 failed" in page
    assert "It may be wrong." in page and ",It may be wrong.," in as_csv(ordered)
    assert "&lt;broken&gt;" in page
    assert page.count("<img") == 5
    assert (
        "Of 9 selected, 6 kept, 3 cut, 0 removed; 2 added. The object has 15 Gaussians, with the parts of those" in page
    )


# Who does what


def test_shards_are_all_scenes_once_and_about_equal():
    scenes = {(f"s{i}.ply", None): [Item(f"s{i}.ply")] * (1 + i * 7 % 13) for i in range(50)}
    shards = [running.shard_of(scenes, number, 4) for number in (1, 2, 3, 4)]
    assert {scene for shard in shards for scene in shard} == set(scenes)
    loads = [sum(map(len, shard.values())) for shard in shards]
    assert max(loads) - min(loads) <= 2
    assert running.shard_of({("a", None): []}, 2, 2) == {}


def test_workers_keep_to_the_memory_and_share_the_scene_with_most_left(tmp_path):
    """Scenes of 1, 2 and 1 parts of memory; the first is at work."""
    items = [Item("a.ply", name="a"), Item("b.ply", name="b"), Item("c.ply", name="c")]
    batch = running._Batch(tmp_path, items, gt.batch.BatchOptions(), print, print)
    a, b, c = keys = [(item.scene, None) for item in items]
    batch._needs, batch._waiting = dict(zip(keys, (1.0, 2.0, 1.0), strict=True)), {key: [1, 2] for key in keys}
    batch._running, batch._memory = {None: running._Worker(None, a, items[0])}, 2.5
    assert batch._next_scene() == c
    del batch._waiting[c]
    assert batch._next_scene() == a
    batch._memory = 1.5
    assert batch._next_scene() is None
    batch._running = {}
    del batch._waiting[a]
    assert batch._next_scene() == b


def test_a_scene_that_does_not_fit_is_refused_before_anything_is_done(folder, tmp_path):
    items = gt.batch.read_manifest(folder / "manifest.csv")
    with pytest.raises(InputError, match=r"may take 0\.4 GB of memory, and the batch"):
        gt.batch.run(items, tmp_path / "out", memory=PROCESS_BYTES / 1e9)
    assert not (tmp_path / "out").exists()
    assert scene_need(str(folder / "s0.ply")) > (folder / "s0.ply").stat().st_size


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"engine": "slurm"}, "engine"),
        ({"workers": 0}, "workers"),
        ({"shard": (4, 3)}, "shard is 4/3"),
        ({"time_limit": float("nan")}, "time-limit"),
        ({"gpus": 1.0}, "those of a cluster"),
        ({"engine": "ray", "memory": 1.0}, "leave the memory out"),
    ],
)
def test_options_that_are_not_possible(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        gt.batch.run([Item("a.ply")], tmp_path, **options)


def test_the_example_for_slurm_names_options_that_exist():
    text = (Path(__file__).parents[1] / "examples" / "06_batch_on_slurm.sh").read_text()
    command_line = text[text.index("python -m") :]
    options = {word[2:].replace("-", "_") for word in command_line.split() if word.startswith("--")}
    assert (
        {"shard", "workers", "memory", "time_limit"}
        <= options
        <= {field.name for kind in (command.Batch, gt.batch.BatchOptions) for field in fields(kind)}
    )
