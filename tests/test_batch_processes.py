"""Batches on processes of this machine: the same bytes, and what they survive."""

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
def test_a_worker_that_dies_ends_the_batch_which_goes_on_later(batch, tmp_path):
    manifest, names, expected = batch
    process = start(manifest, tmp_path, "--workers", 1)
    until(lambda: n_finished(tmp_path) >= 1 and parts(tmp_path))
    (worker,) = workers_of(process)
    os.kill(worker, signal.SIGKILL)
    code, _, err = end(process)
    assert code == 2 and "A worker process died; the machine may have run out of memory." in err
    assert parts(tmp_path) == []
    code, out, err = run(manifest, tmp_path, "--workers", 1)
    assert (code, err) == (0, "") and 0 < fresh_of(out) < len(names)
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
