"""Folders that a stranger has prepared: staging folders, locks and manifests, with links and names that lead out."""

from __future__ import annotations

import json
import os
import random
from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.folders import atomic_folder, remove_leftovers
from gaussian_trimmer.io.writing import write_whole

from .mutations import mutate
from .samples import check_message

_PLACES = (
    ".gaussian-trimmer.part", ".gaussian-trimmer.0123456789ab.part", ".gaussian-trimmer-0123456789ab.part",
    ".gaussian-trimmer.lock", "manifest.json", "views", "object.ply",
)  # fmt: skip
_NAMES = ("object.ply", "views/0", "views/a/b", "views/evil.desktop")
_MINE = {"notes.txt": b"my notes", "photos/1.jpg": b"a photo"}
_ELSEWHERE = {"thesis.txt": b"x", "autostart/mine.desktop": b"mine", "new/a": b"a", "old/b": b"b"}
_MANIFEST = {"program": "gaussian-trimmer", "kind": "trim"}


def try_folder(rng: random.Random, place: Path) -> None:
    """Write to a folder in which things are planted; what lies elsewhere or is the user's own must stay as it is."""
    folder, home = place / "stranger", place / "home"
    for root, files in ((folder, _MINE), (home, _ELSEWHERE)):
        for name, data in files.items():
            _write(root / name, data)
    _write(home / "new" / "manifest.json", json.dumps(_MANIFEST | {"files": {"a": 1}}).encode())
    for name in rng.sample(_PLACES, rng.randint(1, 4)):
        _plant(rng, folder / name, home)
    before = _contents(home)
    for number in range(4):
        try:
            match rng.randrange(4):
                case 0:
                    remove_leftovers(folder)
                case 1:
                    write_whole(folder / rng.choice(("scene.spz", "object.ply")), b"new")
                case 2:
                    _write_results(folder, overwrite=rng.random() < 0.7)
                case _ if not (folder / "views").is_symlink():  # else the user asks for what it leads to
                    _write_results(folder / "views", overwrite=True)
        except InputError as error:
            check_message(error)
        assert _contents(home) == before, number
        assert {name: (folder / name).read_bytes() for name in _MINE} == _MINE, number


def _write_results(folder: Path, *, overwrite: bool) -> None:
    with atomic_folder(folder, "trim", overwrite=overwrite) as results:
        for name in ("object.ply", "views/0", "views/a/b"):
            _write(results / name, b"new")


def _plant(rng: random.Random, path: Path, home: Path) -> None:
    match rng.randrange(7):
        case 0:
            manifest = _manifest(rng, home, **{"notes.txt": len(_MINE["notes.txt"])})
            _write(path, rng.choice((b"", b"{}", manifest, mutate(rng, manifest))))
        case 1:
            os.link(home / "thesis.txt", path)
        case 2:
            os.mkfifo(path)
        case 3 | 4:
            path.symlink_to(rng.choice((home, home / "autostart", home / "thesis.txt", home / "nothing", path)))
        case _:
            _write(path / "new" / "manifest.json", _manifest(rng, home, **{"notes.txt": len(_MINE["notes.txt"])}))
            for half in ("new", "old"):
                for name in rng.sample(_NAMES, 2):
                    _write(path / half / name, b"evil")
            if rng.random() < 0.5:
                inside = path / rng.choice(("linked", "old/views/linked", "new/linked"))
                inside.parent.mkdir(parents=True, exist_ok=True)
                inside.symlink_to(home)
    if rng.random() < 0.5:
        os.utime(path, (0, 0), follow_symlinks=False)


def _manifest(rng: random.Random, home: Path, **more: int) -> bytes:
    """The manifest of results, some of which lie elsewhere, and the sizes of more."""
    names = [*_NAMES, "../home/thesis.txt", str(home / "thesis.txt"), "views/thesis.txt", "views/mine.desktop", ".."]
    sizes = {name: rng.choice((1, 3, 4)) for name in rng.sample(names, 5)}
    return json.dumps(_MANIFEST | {"files": sizes | more}).encode()


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _contents(folder: Path) -> dict[str, bytes]:
    """All files below, none of which is a pipe, by name."""
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
