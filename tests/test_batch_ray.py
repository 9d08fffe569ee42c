"""Batches on a Ray cluster that is started here: the same bytes as on local processes, and lost tasks."""

import sys

import pytest
import toy
from batch_runs import InlineWorkers, contents, save_scenes, write_manifest

import gaussian_trimmer as gt
from gaussian_trimmer.batch import execution
from gaussian_trimmer.batch.ray_cluster import RayTasks
from gaussian_trimmer.batch.scenes import SceneItems
from gaussian_trimmer.batch.worker import WorkerSettings
from gaussian_trimmer.errors import InputError

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a cluster needs Linux")


@pytest.mark.smoke
def test_the_same_bytes_as_local(tmp_path, monkeypatch):
    items = gt.batch.read_manifest(write_manifest(tmp_path, save_scenes(tmp_path, 2, 1)))
    outcomes = gt.batch.run(items, tmp_path / "ray", engine="ray", workers=1)
    assert [(outcome.state, outcome.fresh) for outcome in outcomes] == [("done", True)] * 2
    monkeypatch.setattr(execution, "LocalWorkers", InlineWorkers)
    with toy.one_thread():
        gt.batch.run(items, tmp_path / "local")
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


def test_there_is_no_cluster_at_an_address(tmp_path):
    for address, said in (("127.0.0.1:1", "There is no Ray cluster at"), ("here", "is not the address")):
        with pytest.raises(InputError, match=said):
            gt.batch.run([gt.batch.Item("a.ply")], tmp_path, engine="ray", address=address)


@pytest.mark.slow
def test_a_scene_that_no_node_has_memory_for_and_a_task_that_is_lost(tmp_path, monkeypatch):
    settings = WorkerSettings(str(tmp_path / "out"))
    item = gt.batch.Item("gone.ply", name="a")
    with pytest.raises(InputError, match="no node of the cluster has more"):
        RayTasks([SceneItems("gone.ply", (item,), 1e15)], settings, None, 1, 0.0, 0)
    assert not ray.is_initialized()
    monkeypatch.setattr("gaussian_trimmer.batch.ray_cluster.trim_part", lambda items, settings: sys.exit(1))
    tasks = RayTasks([SceneItems("gone.ply", (item,))], settings, None, 1, 0.0, 0)
    (outcome,) = (outcome for outcome in tasks.outcomes() if outcome is not None)
    assert (outcome.item, outcome.cause) == (item, "worker")
    assert "Its worker was lost" in outcome.message
