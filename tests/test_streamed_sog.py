"""Streamed SOG: levels, boxes, chunks that are missing or lie, and what the commands say."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run
from format_samples import ATTRIBUTES, real, sample

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.commands import select
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import streamed_sog
from gaussian_trimmer.gaussians import Gaussians, concatenate
from gaussian_trimmer.rendering import render

PLAYBOT = Path(__file__).parent / "fixtures" / "playbot"


def streamed(folder: Path, *, degree: int = 0) -> Path:
    """Write a capture of two levels: 50 and 30 Gaussians at x below and above 0 in two chunks, and 20 of the first."""
    sides = [sample(n, degree, seed) for seed, n in enumerate((50, 30))]
    left, right = (g.replace(means=np.abs(g.means) * (side, 1, 1)) for side, g in zip((-1, 1), sides, strict=True))
    names = ("0_0.sog", "0_1.sog", "1_0.sog")
    for name, chunk in zip(names, (left, right, left.select(slice(0, 20))), strict=True):
        formats.write(chunk, folder / name)
    boxes = [{"min": [-99, 0, 0], "max": [0, 99, 99]}, {"min": [0.001, 0, 0], "max": [99, 99, 99]}]
    lods = [
        {"0": {"file": 0, "offset": 10, "count": 40}, "1": {"file": 2, "offset": 0, "count": 20}},
        {"0": {"file": 0, "offset": 0, "count": 10}},
        {"0": {"file": 1, "offset": 0, "count": 30}},
    ]
    leaves = [{"bound": boxes[side], "lods": lod} for side, lod in zip((0, 0, 1), lods, strict=True)]
    tree = {"bound": boxes[0], "children": [{"bound": boxes[0], "children": leaves[:2]}, leaves[2]]}
    meta = {"lodLevels": 2, "environment": "sky.sog", "filenames": list(names), "tree": tree}
    (folder / "lod-meta.json").write_text(json.dumps(meta))
    return folder / "lod-meta.json"


def assert_same(a: Gaussians, b: Gaussians) -> None:
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_a_number_means_the_same_view_at_each_level(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, views = streamed(tmp_path), list[Any]()
    monkeypatch.setattr(select, "render", lambda drawn, camera: views.append(camera) or render(drawn, camera))
    for level in (0, 1):
        assert run("select", scene, "--level", level, "--list-views", tmp_path / f"views{level}", "--quiet") == 0
    first, second = (views[: len(views) // 2], views[len(views) // 2 :])
    assert len(first) > 1
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.world_to_camera, other.world_to_camera)


class TestRead:
    @pytest.mark.parametrize("degree", [0, 2])
    def test_a_level_is_its_chunks_one_after_the_other(self, tmp_path: Path, degree: int) -> None:
        path = streamed(tmp_path, degree=degree)
        chunks = [formats.read(tmp_path / name) for name in ("0_0.sog", "0_1.sog", "1_0.sog")]
        assert_same(gt.read(tmp_path), concatenate(chunks[:2]))
        assert_same(gt.read(path, level=0), concatenate(chunks[:2]))
        assert_same(gt.read(path, level=1), chunks[2])
        assert formats.written_suffix(path) == ".ply"

    def test_a_box_is_the_leaves_that_touch_it(self, tmp_path: Path) -> None:
        path = streamed(tmp_path)
        assert_same(gt.read(path, bounds=((1, 0, 0), (2, 9, 9))), formats.read(tmp_path / "0_1.sog"))
        (tmp_path / "0_1.sog").unlink()  # not needed for what lies elsewhere
        assert len(gt.read(path, level=0, bounds=((-2, 0, 0), (-1, 9, 9)))) == 50
        with pytest.raises(InputError, match="touches the box"):
            gt.read(path, bounds=((0, -9, 0), (2, -8, 9)))

    def test_memory_chooses_the_level(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path, said = streamed(tmp_path), list[str]()
        monkeypatch.setattr(streamed_sog, "total_bytes", lambda: 3.5 * 4 * 14 * 2 * 60)
        assert len(formats.read(path, say=said.append)) == 20
        assert "level 1" in said[0] and "sky.sog" in said[0]
        assert len(formats.read(path, level=0)) == 80
        assert len(formats.read(path, bounds=((1, 0, 0), (2, 9, 9)))) == 30
        assert [file.name for file in formats.scene_files(path)] == ["lod-meta.json", "1_0.sog"]

    def test_missing_chunks_are_named(self, tmp_path: Path) -> None:
        path = streamed(tmp_path)
        (tmp_path / "0_1.sog").unlink()
        with pytest.raises(InputError, match=r"0_1\.sog.*level 1 is complete"):
            gt.read(path)
        assert len(gt.read(path, level=1)) == 20

    @pytest.mark.parametrize("bad", [{"level": 2}, {"level": -1}])
    def test_other_levels_and_formats_are_refused(self, tmp_path: Path, bad: dict[str, Any]) -> None:
        with pytest.raises(InputError, match=r"levels are 0, 1"):
            gt.read(streamed(tmp_path), **bad)
        with pytest.raises(InputError, match="no levels"):
            gt.read(tmp_path / "0_0.sog", **bad)


def _leaf(meta: dict[str, Any], **changes: Any) -> None:
    meta["tree"]["children"][1]["lods"]["0"].update(changes)


LIES: dict[str, Callable[[dict[str, Any]], object]] = {
    "outside": lambda meta: meta["filenames"].__setitem__(1, "../0_1.sog"),
    "absolute": lambda meta: meta["filenames"].__setitem__(1, "/etc/passwd.sog"),
    "another kind": lambda meta: meta["filenames"].__setitem__(1, "0_1.ply"),
    "twice": lambda meta: meta["filenames"].__setitem__(1, "./0_0.sog"),
    "no chunk": lambda meta: _leaf(meta, file=7),
    "too many": lambda meta: _leaf(meta, count=31),
    "far too many": lambda meta: _leaf(meta, count=10**15),
    "before the first": lambda meta: _leaf(meta, offset=-1),
    "overlap": lambda meta: _leaf(meta, file=0, offset=5, count=10),
    "a fraction": lambda meta: _leaf(meta, count=2.5),
    "no count": lambda meta: meta["tree"]["children"][1]["lods"]["0"].pop("count"),
    "no bound": lambda meta: meta["tree"]["children"][1].pop("bound"),
    "endless": lambda meta: meta["tree"]["children"][1]["bound"].update(min=[float("nan")] * 3),
    "no tree": lambda meta: meta.pop("tree"),
    "nothing": lambda meta: meta.update(tree={}),
}


@pytest.mark.parametrize("lie", LIES)
def test_lies_are_refused(tmp_path: Path, lie: str) -> None:
    path = streamed(tmp_path)
    meta = json.loads(path.read_text())
    LIES[lie](meta)
    path.write_text(json.dumps(meta))
    with pytest.raises(InputError, match=r"lod-meta\.json"):
        gt.read(path)


def test_many_small_chunks_cannot_claim_much(tmp_path: Path) -> None:
    """A chunk of a few hundred bytes may claim 65,536 Gaussians; a thousand of them may not."""
    n, names = 65_536, [f"{i}.sog" for i in range(12)]
    formats.write(sample(1, 0).select(np.zeros(n, np.int64)), tmp_path / names[0])
    for name in names[1:]:
        shutil.copy(tmp_path / names[0], tmp_path / name)
    bound = {"min": [-9] * 3, "max": [9] * 3}
    leaves = [{"bound": bound, "lods": {"0": {"file": i, "offset": 0, "count": n}}} for i in range(len(names))]
    meta = {"lodLevels": 1, "filenames": names, "tree": {"bound": bound, "children": leaves}}
    (tmp_path / "lod-meta.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match="announces"):
        gt.read(tmp_path)


class TestCommands:
    def test_info_lists_levels(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = streamed(tmp_path)
        formats.write(sample(5, 0), tmp_path / "sky.sog")  # must not be taken for the capture
        assert run("info", tmp_path) == 0
        text = capsys.readouterr().out
        assert all(words in text for words in ("level 0: 80 ", "level 1: 20 ", "sky.sog is left out"))
        (tmp_path / "0_1.sog").unlink()
        assert run("info", path) == 0
        assert "0_1.sog" in capsys.readouterr().out

    def test_convert_takes_a_level(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = streamed(tmp_path)
        assert run("convert", path, tmp_path / "a.ply", "--level", "1") == 0
        assert len(formats.read(tmp_path / "a.ply")) == 20
        assert "sky.sog is left out" in capsys.readouterr().out

    def test_a_capture_is_trimmed(self, tmp_path: Path) -> None:
        ids = gt.read(PLAYBOT, level=1).means[:, 1] < -0.5
        np.save(tmp_path / "top.npy", ids)
        words = ("--level", "1", "--up", "-y", "--output", tmp_path / "out")
        assert run("trim", PLAYBOT, tmp_path / "top.npy", *words) == 0
        assert len(formats.read(tmp_path / "out" / "object.ply")) > 0
        command = json.loads((tmp_path / "out" / "report.json").read_text())["command"]
        assert command[command.index("--level") + 1] == "1"
        (tmp_path / "a.csv").write_text(f"scene,selection,options\n{PLAYBOT},{tmp_path / 'top.npy'},--level 1\n")
        assert run("batch", tmp_path / "a.csv", "--output", tmp_path / "batch", "--workers", "1") == 0


def test_real_captures() -> None:
    assert (len(gt.read(PLAYBOT)), len(gt.read(PLAYBOT, level=1)), gt.read(PLAYBOT).sh_degree) == (3000, 1873, 2)
    camp = real("camp")
    assert len(gt.read(camp, level=1)) == 212_464
    assert 0 < len(gt.read(camp, level=0, bounds=((-3, -3, -3), (3, 3, 3)))) < 300_000
