"""Batches without faults: the same bytes from every engine, what is done again, memory, summaries and progress."""

import csv
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
import toy
from batch_runs import contents, fresh_of, identities, run, save_scenes, write_manifest

import gaussian_trimmer as gt
from gaussian_trimmer.batch.driver import Status, by_scene
from gaussian_trimmer.batch.memory import PROCESS_BYTES, free_bytes, scene_need
from gaussian_trimmer.batch.storage import AddressStore
from gaussian_trimmer.batch.summary import as_html, doubt
from gaussian_trimmer.commands import batch as command
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.config import PlanConfig
from gaussian_trimmer.errors import InputError

EXAMPLE = Path(__file__).parents[1] / "examples" / "06_batch_on_slurm.sh"


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """A manifest, the names of its items, and the files that a run with one worker leaves."""
    folder = tmp_path_factory.mktemp("batch")
    names = save_scenes(folder, 3, 2)
    manifest = write_manifest(folder, names)
    code, out, err = run(manifest, folder / "out", "--workers", 1)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names)
    return manifest, names, contents(folder / "out")


def test_an_item_is_what_a_trim_in_python_is(batch, tmp_path):
    manifest, names, expected = batch
    folder = manifest.parent
    assert {path.split("/")[0] for path in expected} == set(names)
    scene = gt.read(folder / "s1.ply")
    config = gt.TrimConfig(up=(0.0, 0.0, 1.0), plan=PlanConfig(size=96, views=2))
    with toy.one_thread():
        gt.trim(scene, gt.read_selection(folder / "s1-1.npy", scene), config=config).save(tmp_path / "one")
    for path in (tmp_path / "one").rglob("*"):
        if path.is_file() and path.name not in ("report.json", "manifest.json"):
            assert expected[f"s1-1/{path.relative_to(tmp_path / 'one').as_posix()}"] == path.read_bytes()


def test_python_tells_results_as_they_come(batch, tmp_path):
    manifest, names, expected = batch
    told, statuses = [], []
    items = gt.batch.read_manifest(manifest)
    outcomes = gt.batch.run(items, tmp_path, workers=2, on_result=told.append, on_status=statuses.append)
    assert [outcome.item.name for outcome in outcomes] == names
    assert sorted(outcome.item.name for outcome in told) == names
    assert {outcome.state for outcome in told} == {"done"}
    assert all(outcome.fresh and outcome.views == (2, 2) and outcome.counts["object"] > 600 for outcome in told)
    assert contents(tmp_path) == expected
    assert statuses[-1].done == statuses[-1].total == len(names)
    again = gt.batch.run(items, tmp_path, workers=2)
    assert [(o.item.name, o.counts, o.fingerprint) for o in again] == [
        (o.item.name, o.counts, o.fingerprint) for o in outcomes
    ]
    assert not any(outcome.fresh for outcome in again)


def test_an_error_of_the_caller_ends_the_workers(batch, tmp_path):
    def refuse(outcome):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        gt.batch.run(gt.batch.read_manifest(batch[0]), tmp_path, workers=1, on_result=refuse)
    assert not list(tmp_path.rglob("*.part"))


def test_shards_make_the_whole(batch, tmp_path):
    """The example for Slurm, run as a plain shell with the variables that Slurm sets."""
    manifest, names, expected = batch
    environment = {
        **os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(Path(gt.__file__).parents[1]), "SLURM_ARRAY_TASK_COUNT": "2", "SLURM_CPUS_PER_TASK": "1",
    }  # fmt: skip
    fresh = 0
    for task in ("1", "2"):
        done = subprocess.run(
            ["bash", str(EXAMPLE), str(manifest), str(tmp_path)], env={**environment, "SLURM_ARRAY_TASK_ID": task},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
        assert 0 < fresh_of(done.stdout) < len(names)
        fresh += fresh_of(done.stdout)
    assert fresh == len(names)
    assert contents(tmp_path) == expected
    rows = list(csv.DictReader((tmp_path / "summary.csv").open()))
    assert sorted((row["name"], row["state"]) for row in rows) == [(name, "done") for name in names]


def test_more_shards_than_scenes(batch, tmp_path):
    code, out, err = run(batch[0], tmp_path, "--shard", "4/4", "--workers", 1)
    assert (code, err) == (0, "")
    assert "0 of 0 items are finished" in out


def test_a_store_holds_the_same_bytes(batch, tmp_path):
    """The code for buckets, on files."""
    pytest.importorskip("fsspec")
    manifest, names, expected = batch
    rows = ["scene,selection,name,up,options"]
    place = manifest.parent.as_uri()
    rows += [f"{place}/{n.split('-')[0]}.ply,{place}/{n}.npy,{n},z,--plan.size 96 --views 2" for n in names[:2]]
    (tmp_path / "m.csv").write_text("\n".join(rows))
    output = tmp_path / "out"
    code, out, err = run(tmp_path / "m.csv", output.as_uri(), "--workers", 1)
    assert (code, err) == (0, "")
    ours = {path: data for path, data in contents(output).items() if not path.endswith("item.json")}
    theirs = {path: data for path, data in expected.items() if path.split("/")[0] in names[:2]}
    assert ours == {p: d for p, d in theirs.items() if not p.endswith(("item.json", "manifest.json"))}
    before = identities(output)
    code, out, err = run(tmp_path / "m.csv", output.as_uri(), "--workers", 1)
    assert (code, fresh_of(out)) == (0, 0)
    assert identities(output) == before
    assert AddressStore(output.as_uri()).finished(names[0])
    (output / "items" / names[0] / "labels.npz").write_bytes(b"cut short")
    assert AddressStore(output.as_uri()).finished(names[0]) is None


def test_what_fsspec_does_not_know(tmp_path):
    with pytest.raises(InputError, match=r"nosuch://|fsspec"):
        gt.batch.run([gt.batch.Item("a.ply")], "nosuch://bucket/out")


def test_backgrounds_can_be_left_out(batch, tmp_path):
    manifest, _, expected = batch
    assert run(manifest, tmp_path, "--no-background", "--workers", 2)[0] == 0
    without = {
        path: data for path, data in contents(tmp_path).items() if not path.endswith(("item.json", "manifest.json"))
    }
    assert without == {
        path: data
        for path, data in expected.items()
        if not path.endswith(("item.json", "manifest.json", "background.ply"))
    }


# Memory


def test_a_scene_that_does_not_fit_is_refused_before_anything_is_done(batch, tmp_path):
    code, _, err = run(batch[0], tmp_path / "out", "--memory", PROCESS_BYTES / 1e9)
    assert code == 2
    assert "may take 0.4 GB of memory, and the batch may take 0.4 GB" in err
    assert not (tmp_path / "out").exists()


def test_workers_are_as_many_as_fit(batch, tmp_path, monkeypatch):
    seen = []
    items = gt.batch.read_manifest(batch[0])
    largest = max(entry.need for entry in by_scene(items))
    gt.batch.run(items, tmp_path, workers=3, memory=1.5 * PROCESS_BYTES + largest,
                 on_status=lambda status: seen.append(len(status.running)))  # fmt: skip
    assert max(seen) == 1


def test_need_grows_with_what_a_file_unpacks_to():
    assert scene_need("a.spz", 1000) > scene_need("a.splat", 1000) > scene_need("a.ply", 1000) > 1000
    assert free_bytes() > 0


# Arguments


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"engine": "slurm"}, "Unknown engine 'slurm'; available: local, ray."),
        ({"workers": 0}, "number of workers is 0"),
        ({"shard": (0, 3)}, "shard is 0/3"),
        ({"shard": (4, 3)}, "shard is 4/3"),
        ({"time_limit": 0.0}, "time limit is 0.0"),
        ({"time_limit": float("nan")}, "time limit is nan"),
        ({"retries": -1}, "retries is -1"),
        ({"memory": 0.0}, "memory is 0.0"),
        ({"gpus": 1.0}, "share its GPUs"),
    ],
)
def test_arguments_that_are_not_possible(tmp_path, options, said):
    with pytest.raises(InputError, match=said):
        gt.batch.run([gt.batch.Item("a.ply")], tmp_path, **options)


@pytest.mark.parametrize("shard", ["1", "1/2/3", "a/b", "-1/2", "1/9999999"])
def test_shards_that_are_not_possible(batch, tmp_path, shard):
    code, _, err = run(batch[0], tmp_path, f"--shard={shard}")
    assert code == 2
    assert "give i/n" in err


def test_missing_files_cost_their_items_alone(batch, tmp_path):
    manifest, _, expected = batch
    rows = manifest.read_text() + "gone.ply,s0-0.npy,gone,z,\ns0.ply,gone.npy,gone2,z,\ns0.ply,s0.ply,whole,z,\n"
    (manifest.parent / "gone.csv").write_text(rows)
    code, out, err = run(manifest.parent / "gone.csv", tmp_path, "--workers", 2)
    assert code == 2
    assert "3 of 9 items failed" in err
    assert "failed: gone: There is no file" in out
    assert "failed: gone2: Cannot read" in out
    assert "failed: whole: " in out
    assert contents(tmp_path) == expected


# What is told


def outcome(name, **changes):
    made = gt.batch.Outcome(gt.batch.Item("a.ply", name=name), "done", counts={"selected": 100}, views=(5, 5))
    return gt.batch.Outcome(**{**vars(made), **changes})


def test_the_worst_come_first():
    ordered = [
        outcome("a", state="failed", message="<broken>"), outcome("b", refused="too little"),
        outcome("c", views=(2, 5)), outcome("d", counts={"selected": 100, "removed": 30}), outcome("e"),
    ]  # fmt: skip
    doubts = [doubt(entry) for entry in ordered]
    assert doubts == sorted(doubts, reverse=True)
    assert len(set(doubts)) == 5
    page = as_html(ordered)
    assert "5 items: 4 done, 1 failed" in page
    assert "&lt;broken&gt;" in page
    assert page.count("<img") == 4


def test_progress_on_a_terminal(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    console = open_console(quiet=False)
    console.file, console._force_terminal, console.is_interactive = io.StringIO(), True, True
    with command._progress(console) as shown:
        shown.tell_outcome(outcome("x", state="failed", message="it is\x1b[31m broken"))
        shown.tell_status(Status(10, 4, 1, 1, {0: ("a/b", 3.0)}, 2))
        shown.live.refresh()
    text = console.file.getvalue()
    assert "failed: x: it is\\x1b[31m broken" in text
    assert "5 of 10 items, 1 failed, 1 from before" in text
    assert "worker 0: a/b, 3 s" in text


def test_nothing_is_told_quietly(batch, tmp_path):
    assert run(batch[0], tmp_path, "--quiet", "--workers", 2)[1] == ""


def test_the_package_is_loaded_when_it_is_used():
    code = (
        "import sys, gaussian_trimmer as gt; m = sys.modules; print('numba' in m, gt.batch.Item.__name__, 'ray' in m)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          env={**os.environ, "PYTHONPATH": str(Path(gt.__file__).parents[1])})  # fmt: skip
    assert done.stdout.split() == ["False", "Item", "False"]
