"""Batches on a Ray cluster of two nodes: the same bytes, and what they survive."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from batch_runs import (
    QUICK,
    SLOW,
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

pytest.importorskip("ray")
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks for processes in /proc")
MEMORY = 4 << 30


@pytest.fixture(scope="module")
def cluster():
    """The address of a cluster of two nodes with one processor each."""
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "memory": MEMORY, "object_store_memory": 100 << 20}
    made = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
    made.add_node(**node)
    yield made
    made.shutdown()


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    """A manifest of slow items, their names, and the files of a run on local processes."""
    folder = tmp_path_factory.mktemp("batch")
    names = save_scenes(folder, 2, 3)
    manifest = write_manifest(folder, names, SLOW)
    code, _, err = run(manifest, folder / "out", "--workers", 2)
    assert (code, err) == (0, "")
    return manifest, names, contents(folder / "out")


def on(cluster):
    return "--engine", "ray", "--address", cluster.address


def workers():
    """Numbers of the processes that are workers of batches on a cluster of this machine."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if b"ray::GaussianTrimmerWorker" in path.read_bytes():
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


@pytest.fixture(autouse=True)
def no_workers_of_before(cluster):
    until(lambda: not workers(), 60)


def test_the_same_bytes_as_local(cluster, batch, tmp_path):
    manifest, names, expected = batch
    code, out, err = run(manifest, tmp_path, *on(cluster))
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names)
    assert contents(tmp_path) == expected
    code, out, err = run(manifest, tmp_path, *on(cluster))
    assert (code, fresh_of(out)) == (0, 0)


def test_a_cluster_of_its_own(batch, tmp_path):
    manifest, names, _ = batch
    write_manifest(manifest.parent, names[:2], QUICK, "few.csv")
    code, out, err = run(manifest.parent / "few.csv", tmp_path, "--engine", "ray", "--workers", 1)
    assert (code, err) == (0, "")
    assert fresh_of(out) == 2


def test_a_cluster_of_its_own_joins_no_other(cluster, tmp_path):
    """Ray would join the cluster that was started last, and what it asks of it can differ from what that expects."""
    code = f"""
from gaussian_trimmer.batch.ray_cluster import RayEngine
import ray
engine = RayEngine({str(tmp_path)!r})
print(ray.get_runtime_context().gcs_address)
engine.close()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.strip() != cluster.address


@pytest.mark.parametrize("moment", [is_trimming, is_writing])
def test_killed_workers(cluster, batch, tmp_path, moment):
    manifest, names, expected = batch
    driver = start(manifest, tmp_path, *on(cluster))
    until(lambda: n_finished(tmp_path) >= 1 and moment(tmp_path))
    for worker in workers():
        kill(worker)
    code, out, err = end(driver)
    assert (code, err) == (0, "")
    assert len(names) - 2 <= fresh_of(out) <= len(names)  # A worker may die after its item is there.
    assert contents(tmp_path) == expected
    assert parts(tmp_path) == []


@pytest.mark.parametrize("moment", [is_trimming, is_writing])
def test_killed_driver_started_again(cluster, batch, tmp_path, moment):
    manifest, names, expected = batch
    driver = start(manifest, tmp_path, *on(cluster))
    until(lambda: n_finished(tmp_path) >= 1 and moment(tmp_path))
    kill(driver.pid)
    end(driver)
    until(lambda: not workers(), 60)
    before, finished = identities(tmp_path), n_finished(tmp_path)
    code, out, err = run(manifest, tmp_path, *on(cluster))
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names) - finished
    assert contents(tmp_path) == expected
    assert before.items() <= identities(tmp_path).items()
    assert parts(tmp_path) == []


def test_more_workers_than_the_cluster_has_room_for(cluster, batch, tmp_path):
    manifest, names, expected = batch
    code, out, err = run(manifest, tmp_path, *on(cluster), "--workers", 4)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names)
    assert contents(tmp_path) == expected


def test_lost_node(cluster, batch, tmp_path):
    manifest, names, expected = batch
    node = cluster.add_node(num_cpus=1, memory=MEMORY, object_store_memory=100 << 20)
    driver = start(manifest, tmp_path, *on(cluster), "--workers", 3)
    until(lambda: n_finished(tmp_path) >= 1 and len(workers()) == 3)
    cluster.remove_node(node, allow_graceful=False)
    code, out, err = end(driver)
    assert (code, err) == (0, "")
    assert fresh_of(out) == len(names)
    assert contents(tmp_path) == expected


def test_corrupt_scene_and_hanging_worker(cluster, batch, tmp_path):
    manifest, names, expected = batch
    folder = manifest.parent
    (folder / "s3.ply").write_bytes((folder / "s0.ply").read_bytes()[:-40])
    (folder / "s3-0.npy").write_bytes((folder / "s0-0.npy").read_bytes())
    mixed = write_manifest(folder, [*names[:3], "s3-0", *names[3:]], SLOW, "mixed.csv")
    limit = generous_limit(folder / "out")
    driver = start(mixed, tmp_path, *on(cluster), "--workers", 1, "--time-limit", limit)
    until(lambda: n_finished(tmp_path) >= 1 and is_trimming(tmp_path))
    (worker,) = workers()
    kill(worker, signal.SIGSTOP)
    code, out, err = end(driver)
    assert code == 2
    assert "2 of 7 items failed" in err
    assert "failed: s3-0: " in out
    assert f"It took longer than the time limit of {limit} seconds." in out
    assert not is_alive(worker)
    code, out, err = run(mixed, tmp_path, *on(cluster), "--retry-failed")
    assert code == 2
    assert fresh_of(out) == 1
    assert contents(tmp_path) == expected


def test_two_drivers_on_one_output(cluster, batch, tmp_path):
    manifest, names, expected = batch
    drivers = [start(manifest, tmp_path, *on(cluster), "--workers", 1), start(manifest, tmp_path, "--workers", 1)]
    ends = [end(driver) for driver in drivers]
    assert [(code, err) for code, _, err in ends] == [(0, "")] * 2
    assert sum(fresh_of(out) for _, out, _ in ends) == len(names)
    assert contents(tmp_path) == expected


def test_full_disk(cluster, batch, tmp_path):
    manifest, names, expected = batch
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root can mount a small disk, and not everywhere")
    try:
        free = os.statvfs(disk)
        room = sum(map(len, expected.values())) // 3
        (disk / "fill").write_bytes(bytes(free.f_bavail * free.f_bsize - room))
        code, _, err = run(manifest, disk / "out", *on(cluster))
        assert code == 2
        assert "No space left on device" in err
        finished = n_finished(disk / "out")
        assert 0 < finished < len(names)
        (disk / "fill").unlink()
        code, out, err = run(manifest, disk / "out", *on(cluster))
        assert (code, err) == (0, "")
        assert fresh_of(out) == len(names) - finished
        assert contents(disk / "out") == expected
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


def test_no_such_cluster_and_no_room(cluster, batch, tmp_path):
    code, _, err = run(batch[0], tmp_path, "--engine", "ray", "--address", "127.0.0.1:1")
    assert code == 2
    assert "There is no Ray cluster at '127.0.0.1:1'" in err
