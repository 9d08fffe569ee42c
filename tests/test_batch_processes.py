"""Batches on processes of this machine: the same bytes, and what they survive."""

import multiprocessing
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from batch_runs import (
    SLOW,
    contents,
    end,
    fresh_of,
    is_alive,
    n_finished,
    parts,
    run,
    save_scenes,
    start,
    until,
    workers_of,
    write_manifest,
)

import gaussian_trimmer as gt

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for processes in /proc")
EXAMPLE = Path(__file__).parents[1] / "examples" / "06_batch_on_slurm.sh"


def test_an_item_that_kills_its_worker_costs_itself_alone(tmp_path):
    """It is tried again alone, and recorded."""
    manifest = write_manifest(tmp_path, save_scenes(tmp_path, 1, 3))
    rows = manifest.read_text().splitlines()
    rows[2] = rows[2].replace("--views 2", "--views 200")  # so long that it is seen at work
    manifest.write_text("\n".join(rows))
    items = gt.batch.read_manifest(manifest)

    def kill(status):
        if parts(tmp_path / "out" / "items" / "s0-1"):
            kill.times += 1
            for process in multiprocessing.active_children():
                process.kill()

    kill.times = 0
    outcomes = gt.batch.run(items, tmp_path / "out", workers=1, on_status=kill)
    assert [outcome.state for outcome in outcomes] == ["done", "failed", "done"]
    assert kill.times >= 2
    assert "died" in outcomes[1].message
    assert parts(tmp_path) == []
    assert (tmp_path / "out" / "records" / "s0-1.json").exists()
    assert multiprocessing.active_children() == []


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """A manifest of slow items, their names, and the files of an undisturbed run."""
    folder = tmp_path_factory.mktemp("batch")
    names = save_scenes(folder, 2, 3)
    manifest = write_manifest(folder, names, SLOW)
    code, out, err = run(manifest, folder / "out", "--workers", 1)
    assert (code, err, fresh_of(out)) == (0, "", len(names))
    return manifest, names, contents(folder / "out")


@pytest.mark.slow
def test_a_batch_that_was_killed_is_completed(batch, tmp_path):
    manifest, names, expected = batch
    killed = start(manifest, tmp_path, "--workers", 2)
    until(lambda: n_finished(tmp_path) >= 1)
    workers = workers_of(killed)
    assert len(workers) == 2
    killed.kill()
    end(killed)
    until(lambda: not any(map(is_alive, workers)), 30)
    finished = n_finished(tmp_path)
    assert 1 <= finished < len(names)
    code, out, err = run(manifest, tmp_path, "--workers", 2)
    assert (code, err, fresh_of(out)) == (0, "", len(names) - finished)
    assert contents(tmp_path) == expected
    assert parts(tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_batch_leaves_nothing_half_written(batch, tmp_path, number):
    manifest, names, expected = batch
    process = start(manifest, tmp_path, "--workers", 2)
    until(lambda: n_finished(tmp_path) >= 1 and parts(tmp_path))
    workers = workers_of(process)
    process.send_signal(number)
    code, _, err = end(process)
    assert code == 128 + number
    told = re.fullmatch(r"gaussian-trimmer: Stopped after (\d) of 6 items; the same command goes on\.\n", err)
    finished = n_finished(tmp_path)  # The batch may not yet have heard of the last item of each worker.
    assert finished - len(workers) <= int(told[1]) <= finished < len(names)
    assert [folder for folder, folders, files in os.walk(tmp_path / "items") if not folders + files] == []
    assert not any(map(is_alive, workers))
    assert parts(tmp_path) == []
    assert contents(tmp_path).items() <= expected.items()


@pytest.mark.slow
def test_an_item_that_takes_too_long_is_ended(batch, tmp_path):
    manifest, names, expected = batch
    rows = manifest.read_text()
    slow = manifest.with_name("slow.csv")
    slow.write_text(
        rows.replace(f"{names[1]},z,--plan.size 256 --views 4", f"{names[1]},z,--plan.size 1024 --views 1000")
    )
    code, out, err = run(slow, tmp_path, "--workers", 1, "--time-limit", 20)
    assert code == 2
    assert f"failed: {names[1]}: It took longer than the time limit of 20 seconds." in out
    assert "1 of 6 items failed" in err
    assert parts(tmp_path) == []
    code, out, err = run(manifest, tmp_path, "--workers", 1)
    assert (code, err, fresh_of(out)) == (0, "", 1)
    assert contents(tmp_path) == expected


@pytest.mark.slow
def test_two_batches_on_one_output(batch, tmp_path):
    manifest, names, expected = batch
    processes = [start(manifest, tmp_path, "--workers", 1) for _ in range(2)]
    ends = [end(process) for process in processes]
    assert [(code, err) for code, _, err in ends] == [(0, "")] * 2
    assert sum(fresh_of(out) for _, out, _ in ends) == len(names)
    assert contents(tmp_path) == expected


@pytest.mark.slow
def test_shards_make_the_whole(batch, tmp_path):
    """The example for Slurm, run by a plain shell with the variables that Slurm sets."""
    manifest, names, expected = batch
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(Path(gt.__file__).parents[1]),
        "SLURM_ARRAY_TASK_COUNT": "2",
        "SLURM_CPUS_PER_TASK": "1",
    }
    for task in ("1", "2"):
        command = ["bash", str(EXAMPLE), str(manifest), str(tmp_path)]
        done = subprocess.run(
            command, env={**environment, "SLURM_ARRAY_TASK_ID": task}, capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr, fresh_of(done.stdout)) == (0, "", len(names) // 2)
    assert contents(tmp_path) == expected
    assert (tmp_path / "summary.csv").read_text().count(",done,") == len(names)


@pytest.mark.slow
def test_a_script_that_is_imported_by_its_workers_is_told_so(batch, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"""
import gaussian_trimmer as gt

gt.batch.run(gt.batch.read_manifest({str(batch[0])!r}), {str(tmp_path / "out")!r}, workers=1)
""")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "the call must stand below" in done.stderr.splitlines()[-1]
