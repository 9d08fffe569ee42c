"""What batches survive, done for real: killed workers and drivers, disks that fill up, broken and hanging scenes."""

import csv
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from batch_runs import (
    ENDLESS,
    SLOW,
    children,
    contents,
    end,
    fresh_of,
    generous_limit,
    identities,
    is_alive,
    is_trimming,
    is_writing,
    kill,
    n_finished,
    parts,
    run,
    save_scenes,
    start,
    until,
    write_manifest,
)

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for processes in /proc")


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """A manifest of slow items, their names, and the files of an undisturbed run."""
    folder = tmp_path_factory.mktemp("batch")
    names = save_scenes(folder, 2, 3)
    manifest = write_manifest(folder, names, SLOW)
    code, _, err = run(manifest, folder / "out", "--workers", 2)
    assert (code, err) == (0, "")
    return manifest, names, contents(folder / "out")


@pytest.mark.parametrize("moment", [is_trimming, is_writing])
def test_killed_worker(batch, tmp_path, moment):
    manifest, names, expected = batch
    driver = start(manifest, tmp_path, "--workers", 2)
    until(lambda: n_finished(tmp_path) >= 1)
    until(lambda: moment(tmp_path))
    for worker in children(driver):  # one of them is at that moment
        kill(worker)
    code, out, err = end(driver)
    assert (code, err) == (0, "")
    assert contents(tmp_path) == expected
    assert len(names) - 2 <= fresh_of(out) <= len(names)  # A worker may die after its item is there.
    assert parts(tmp_path) == []


def test_worker_that_dies_again_and_again_costs_one_item(batch, tmp_path):
    manifest, names, expected = batch
    write_manifest(manifest.parent, names, SLOW, "deadly.csv", s1_1=ENDLESS)
    driver = start(manifest.parent / "deadly.csv", tmp_path, "--workers", 1, "--retries", 1)
    for finished in (4, 5):  # It is tried once more after the others.
        until(lambda finished=finished: n_finished(tmp_path) == finished and is_trimming(tmp_path))
        kill(children(driver)[0])
    code, _, err = end(driver)
    assert code == 2
    assert "1 of 6 items failed; the first: s1-1: Its worker was killed by SIGKILL" in err
    done = {name: data for name, data in expected.items() if not name.startswith("s1-1/")}
    assert contents(tmp_path) == done


@pytest.mark.parametrize("moment", [is_trimming, is_writing])
def test_killed_driver_started_again(batch, tmp_path, moment):
    manifest, names, expected = batch
    driver = start(manifest, tmp_path, "--workers", 2)
    until(lambda: n_finished(tmp_path) >= 1 and moment(tmp_path))
    workers = children(driver)
    assert len(workers) == 2
    kill(driver.pid)
    end(driver)
    until(lambda: not any(map(is_alive, workers)), 30)
    before = identities(tmp_path)
    finished = n_finished(tmp_path)
    assert 1 <= finished < len(names)
    code, out, err = run(manifest, tmp_path, "--workers", 2)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names) - finished
    assert contents(tmp_path) == expected
    assert before.items() <= identities(tmp_path).items()
    assert parts(tmp_path) == []


def test_interrupted_driver_leaves_nothing_half_written(batch, tmp_path):
    manifest, _, expected = batch
    driver = start(manifest, tmp_path, "--workers", 2)
    until(lambda: n_finished(tmp_path) >= 1 and is_trimming(tmp_path))
    workers = children(driver)
    kill(driver.pid, signal.SIGINT)
    code, _, err = end(driver)
    assert (code, err) == (130, "")
    assert not any(map(is_alive, workers))
    assert parts(tmp_path) == []
    assert contents(tmp_path).items() <= expected.items()


@pytest.fixture
def disk(tmp_path):
    """A disk of its own, of 16 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root can mount a small disk, and not everywhere")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_full_disk(batch, disk):
    manifest, names, expected = batch
    output = disk / "out"
    room = sum(map(len, expected.values())) // 3
    free = os.statvfs(disk)
    (disk / "fill").write_bytes(bytes(free.f_bavail * free.f_bsize - room))
    code, _, err = run(manifest, output, "--workers", 2)
    assert code == 2
    assert "No space left on device" in err
    assert err.count("\n") == 1
    finished = n_finished(output)
    assert 0 < finished < len(names)
    assert contents(output).items() <= expected.items()
    assert parts(output) == []
    before = identities(output)
    (disk / "fill").unlink()
    code, out, err = run(manifest, output, "--workers", 2)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names) - finished
    assert contents(output) == expected
    assert before.items() <= identities(output).items()


@pytest.fixture
def lock_and_unlock(tmp_path):
    """Functions that make a folder read-only, also for root, and writable again."""
    locked = []

    def change(folder, sign):
        if os.geteuid() == 0:
            done = subprocess.run(["chattr", f"{sign}i", str(folder)], capture_output=True, check=False)
            if done.returncode:
                pytest.skip("no folder can be made read-only for root here")
        else:
            folder.chmod(0o555 if sign == "+" else 0o755)

    def lock(folder):
        change(folder, "+")
        locked.append(folder)

    def unlock(folder):
        change(folder, "-")
        locked.remove(folder)

    yield lock, unlock
    for folder in locked:
        change(folder, "-")


def test_output_made_read_only(batch, tmp_path, lock_and_unlock):
    lock, unlock = lock_and_unlock
    manifest, names, expected = batch
    probe = tmp_path / "probe"
    probe.mkdir()
    lock(probe)
    unlock(probe)
    output = tmp_path / "out"
    driver = start(manifest, output, "--workers", 2)
    until(lambda: n_finished(output) >= 1)
    lock(output / "items")
    code, _, err = end(driver)
    assert code == 2
    assert "not permitted" in err or "denied" in err
    unlock(output / "items")
    finished = n_finished(output)
    assert 1 <= finished < len(names)
    before = identities(output)
    code, out, err = run(manifest, output, "--workers", 2)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names) - finished
    assert contents(output) == expected
    assert before.items() <= identities(output).items()


def test_corrupt_and_hanging_scenes_in_the_middle(batch, tmp_path):
    manifest, _, expected = batch
    folder = manifest.parent
    names = [f"s{s}-{k}" for s in (0, 3, 1) for k in range(3)]
    data = (folder / "s0.ply").read_bytes()
    (folder / "s3.ply").write_bytes(data[:-40])
    for k in range(3):
        (folder / f"s3-{k}.npy").write_bytes((folder / f"s0-{k}.npy").read_bytes())
    mixed = write_manifest(folder, names, SLOW, "mixed.csv", s1_1=ENDLESS)
    limit = generous_limit(folder / "out")
    code, out, err = run(mixed, tmp_path, "--workers", 1, "--time-limit", limit)
    assert code == 2
    assert err.count("\n") == 1
    assert "4 of 9 items failed" in err
    assert out.count("failed: s3-") == 3
    assert f"failed: s1-1: It took longer than the time limit of {limit} seconds." in out
    done = {name: data for name, data in expected.items() if not name.startswith("s1-1/")}
    assert contents(tmp_path) == done
    table = list(csv.DictReader((tmp_path / "summary.csv").open()))
    assert {row["name"] for row in table[:4]} == {"s3-0", "s3-1", "s3-2", "s1-1"}
    assert {row["state"] for row in table[4:]} == {"done"}
    before = identities(tmp_path)
    code, out, err = run(mixed, tmp_path, "--workers", 1)  # failed ones are not tried again unasked
    assert code == 2
    assert fresh_of(out) == 0
    (folder / "s3.ply").write_bytes(data)  # mended files are
    write_manifest(folder, names, SLOW, "mixed.csv")  # and so are items with other settings
    code, out, err = run(mixed, tmp_path, "--workers", 1)
    assert (code, err) == (0, "")
    assert fresh_of(out) == 4
    assert expected.items() <= contents(tmp_path).items()
    assert before.items() <= identities(tmp_path).items()


def test_stopped_worker_is_ended_by_the_time_limit(batch, tmp_path):
    manifest, _, expected = batch
    driver = start(manifest, tmp_path, "--workers", 1, "--time-limit", generous_limit(manifest.parent / "out"))
    until(lambda: n_finished(tmp_path) >= 1 and is_trimming(tmp_path))
    kill(children(driver)[0], signal.SIGSTOP)
    code, _, err = end(driver)
    assert code == 2
    assert "1 of 6 items failed" in err
    code, out, err = run(manifest, tmp_path, "--workers", 1, "--retry-failed")
    assert (code, err) == (0, "")
    assert fresh_of(out) == 1
    assert contents(tmp_path) == expected


def test_a_machine_that_stood_still_costs_no_item(batch, tmp_path):
    manifest, names, expected = batch
    limit = generous_limit(manifest.parent / "out")
    driver = start(manifest, tmp_path, "--workers", 1, "--time-limit", limit)
    until(lambda: n_finished(tmp_path) >= 1 and is_trimming(tmp_path))
    everything = [driver.pid, *children(driver)]
    for number in everything:
        kill(number, signal.SIGSTOP)
    time.sleep(limit + 3)
    for number in everything:
        kill(number, signal.SIGCONT)
    code, out, err = end(driver)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names)
    assert contents(tmp_path) == expected


def test_two_drivers_on_one_output(batch, tmp_path):
    manifest, names, expected = batch
    drivers = [start(manifest, tmp_path, "--workers", 1) for _ in range(2)]
    ends = [end(driver) for driver in drivers]
    assert [(code, err) for code, _, err in ends] == [(0, "")] * 2
    assert sum(fresh_of(out) for _, out, _ in ends) == len(names)
    assert contents(tmp_path) == expected


def test_changed_inputs_are_trimmed_again_and_others_not(batch, tmp_path):
    manifest, names, _ = batch
    folder = tmp_path / "in"
    folder.mkdir()
    save_scenes(folder, 2, 2)
    names = [name for name in names if name in {"s0-0", "s0-1", "s1-0", "s1-1"}]
    manifest = write_manifest(folder, names)
    assert run(manifest, tmp_path / "out", "--workers", 1)[0] == 0
    selection = np.load(folder / "s0-1.npy")
    os.utime(folder / "s1.ply")
    np.save(folder / "s0-1.npy", selection & (np.arange(len(selection)) % 50 > 0))
    before = identities(tmp_path / "out")
    code, out, _ = run(manifest, tmp_path / "out", "--workers", 1)
    assert (code, fresh_of(out)) == (0, 1)
    after = identities(tmp_path / "out")
    changed = {name.split("/")[0] for name in before if before[name] != after[name]}
    assert changed == {"s0-1"}
    (tmp_path / "out" / "items" / "s1-0" / "object.ply").unlink()
    code, out, _ = run(manifest, tmp_path / "out", "--workers", 1)
    assert (code, fresh_of(out)) == (0, 1)
