"""Batches on a Ray cluster that is started here: the same bytes as in this process, and lost tasks."""

import os
import sys

import pytest
import toy
from batch_runs import contents, fresh_of, inline, save_scenes, write_manifest
from command_line import run

from gaussian_trimmer.commands import batch as command
from gaussian_trimmer.commands.pools import on_ray

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a cluster needs Linux")


@pytest.mark.smoke
def test_the_same_bytes_as_local(tmp_path, monkeypatch, capsys):
    words = ["batch", write_manifest(tmp_path, save_scenes(tmp_path, 2, 1)), "--output"]
    assert run(*words, tmp_path / "ray", "--engine", "ray", "--workers", 1) == 0
    assert fresh_of(capsys.readouterr().out) == 2
    assert not ray.is_initialized()
    monkeypatch.setattr(command, "on_processes", inline)
    with toy.one_thread():
        assert run(*words, tmp_path / "local") == 0
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


def test_what_cannot_be_had(tmp_path, monkeypatch, capsys):
    words = ["batch", write_manifest(tmp_path, save_scenes(tmp_path, 1, 1)), "--output", tmp_path, "--engine", "ray"]
    assert run(*words, "--address", "127.0.0.1:1") == 2
    assert "no Ray cluster at" in capsys.readouterr().err
    monkeypatch.setattr(ray, "init", refuse)
    assert run(*words) == 2
    assert "timed out during startup" in capsys.readouterr().err


def refuse(**options):
    raise Exception("The current node timed out during startup.")  # as Ray raises it


@pytest.mark.slow
def test_a_task_that_is_lost_costs_no_other():
    def answer_or_die(dies):  # within, so that the cluster need not import this file
        if dies:
            os._exit(1)
        return "alive"

    found = dict(on_ray(answer_or_die, [(False,), (True,), (False,)], workers=1))
    assert (found[0], found[2]) == ("alive", "alive") and found[1].startswith("Its process was lost")
