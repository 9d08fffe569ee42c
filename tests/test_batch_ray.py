"""Batches on a Ray cluster that is started here: the same bytes as on local processes, and lost tasks."""

import os
import sys

import pytest
import toy
from batch_runs import InlineProcesses, contents, save_scenes, write_manifest

import gaussian_trimmer as gt
from gaussian_trimmer.batch import running
from gaussian_trimmer.errors import InputError

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a cluster needs Linux")


class Deadly:
    """An `ItemTrimmer` whose process dies."""

    def __init__(self, **options):
        pass

    def trim(self, item):
        os._exit(1)


@pytest.mark.smoke
def test_the_same_bytes_as_local(tmp_path, monkeypatch):
    items = gt.batch.read_manifest(write_manifest(tmp_path, save_scenes(tmp_path, 2, 1)))
    outcomes = gt.batch.run(items, tmp_path / "ray", engine="ray", workers=1)
    assert [(outcome.state, outcome.fresh) for outcome in outcomes] == [("done", True)] * 2
    monkeypatch.setattr(running, "LocalProcesses", InlineProcesses)
    with toy.one_thread():
        gt.batch.run(items, tmp_path / "local")
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


def test_what_cannot_be_had(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="no Ray cluster at"):
        gt.batch.run([gt.batch.Item("a.ply")], tmp_path, engine="ray", address="127.0.0.1:1")
    monkeypatch.setattr(ray, "init", refuse)
    with pytest.raises(InputError, match="timed out during startup"):
        gt.batch.run([gt.batch.Item("a.ply")], tmp_path, engine="ray")


def refuse(**options):
    raise Exception("The current node timed out during startup.")  # as Ray raises it


@pytest.mark.slow
def test_a_scene_that_no_node_has_memory_for_and_a_task_that_is_lost(tmp_path, monkeypatch):
    items = [gt.batch.Item("gone.ply", name="a")]
    with monkeypatch.context() as patch:
        patch.setattr("gaussian_trimmer.batch.running.scene_need", lambda *scene: 1e15)
        with pytest.raises(InputError, match="no node of the cluster has more"):
            gt.batch.run(items, tmp_path, engine="ray", workers=1)
    assert not ray.is_initialized()
    monkeypatch.setattr("gaussian_trimmer.batch.ray_cluster.ItemTrimmer", Deadly)
    (outcome,) = gt.batch.run(items, tmp_path, engine="ray", workers=1, retries=0)
    assert "died" in outcome.message
