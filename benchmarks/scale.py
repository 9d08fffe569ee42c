"""What do batches cost? Items a minute and memory against workers.

    python benchmarks/scale.py [--data ROOT ...] [--objects 200] [--engines local ray] [--workers 1 2] [--output DIR]

The manifest has copies of benchmark scenes, each turned by a rotation of its own, so that no two are equal; every
object of a scene is an item. A loop in Python over the same items, with each scene read once, is what batches are held
against. Whatever is measured runs in a process of its own, from the start of the interpreter to its end.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import shutil
import subprocess
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_scenes import open_scene
from quality import parser_of
from rich.console import Console
from rich.table import Table

from gaussian_trimmer import formats
from gaussian_trimmer.commands.pools import cores
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import rotation_matrices
from gaussian_trimmer.geometry.harmonics import turned
from gaussian_trimmer.io.reading import is_file

DATA = Path(__file__).parent / "data"
_SAMPLE_PAUSE = 0.1
Record = dict[str, Any]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--data", nargs="+", type=Path, default=[DATA / "tabletop"], help="benchmark scenes")
    parser.add_argument("--kind", default="dilated", help="which kind of selection is trimmed")
    parser.add_argument("--objects", type=int, default=200, help="number of items")
    parser.add_argument("--engines", nargs="+", choices=("local", "ray"), default=["local"])
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--output", type=Path, default=Path("out/scale"))
    parser.add_argument("--no-background", action="store_true", help="leave out the background of each item")
    parser.add_argument("--no-loop", action="store_true", help="leave out the loop in Python, which writes backgrounds")
    parser.add_argument("--repeat", type=int, default=1, help="measure everything so many times; the best counts")
    arguments = parser.parse_args()
    console = Console()
    arguments.output.mkdir(parents=True, exist_ok=True)
    manifest = make_manifest(arguments.data, arguments.kind, arguments.objects, arguments.output / "scenes")
    runs: list[tuple[str, int]] = [("loop", 1)] if not arguments.no_loop else []
    runs += [(engine, workers) for engine in arguments.engines for workers in arguments.workers]
    results = []
    for engine, workers in runs:
        tries = [measure(engine, workers, manifest, arguments) for _ in range(arguments.repeat)]
        results.append(max(tries, key=lambda record: float(record["items_per_minute"])))
        console.print(f"{engine} {workers}: {results[-1]['items_per_minute']:.1f} items a minute")
    record: Record = {
        "machine": f"{platform.processor() or platform.machine()}, {cores()} processors",
        "results": results,
    }
    (arguments.output / "scale.json").write_text(json.dumps(record, indent=1) + "\n")
    table = Table("engine", "workers", "items", "seconds", "items a minute", "peak memory, MB")
    for r in results:
        table.add_row(r["engine"], str(r["workers"]), str(r["items"]), f"{r['seconds']:.1f}",
                      f"{r['items_per_minute']:.1f}", f"{r['peak_bytes'] / 1e6:.0f}")  # fmt: skip
    console.print(table)


def make_manifest(roots: Sequence[Path], kind: str, n: int, folder: Path) -> Path:
    """Write turned copies of scenes, their selections and a manifest of n items; what is there already is kept."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, rows = np.random.default_rng(0), ["scene,selection,name,up"]
    scenes = [scene for scene in map(open_scene, roots) if any(kind in scene.coarse_kinds(o) for o in scene.objects)]
    if not scenes:
        raise InputError(f"No scene has a selection '{kind}'.")
    for copy in count():
        scene = scenes[copy % len(scenes)]
        rotation = rotation_matrices(rng.normal(size=(1, 4)).astype(np.float32))[0].astype(np.float64)
        name = f"{scene.name}-{copy:03d}"
        if not is_file(folder / f"{name}.ply"):
            formats.write(turned(scene.gaussians.replace(extras={}), rotation), folder / f"{name}.ply")
        up = " ".join(f"{value:.9f}" for value in rotation @ np.array([0.0, 0.0, 1.0]))
        for thing in (thing for thing in scene.objects if kind in scene.coarse_kinds(thing)):
            np.save(folder / f"{scene.name}-{thing}.npy", scene.coarse(thing, kind))
            rows.append(f"{name}.ply,{scene.name}-{thing}.npy,{name}/{thing},{up}")
        if len(rows) > n:
            break
    manifest = folder / f"manifest-{n}.csv"
    manifest.write_text("\n".join(rows[: n + 1]) + "\n")
    return manifest


def measure(engine: str, workers: int, manifest: Path, arguments: Namespace) -> Record:
    """Run a batch, or the loop; seconds, items a minute, and the peak of all its processes' memory together."""
    output = arguments.output / f"{engine}-{workers}"
    shutil.rmtree(output, ignore_errors=True)
    if engine == "loop":
        command = [sys.executable, str(Path(__file__)), "--loop-over", str(manifest), str(output)]
    else:
        command = [sys.executable, "-m", "gaussian_trimmer", "batch", str(manifest), "--output", str(output), "--quiet"]
        command += ["--engine", engine, "--workers", str(workers)]
        command += ["--options", "--no-write-background"] if arguments.no_background else []
    start = time.perf_counter()
    process = subprocess.Popen(command)
    peak = _Peak(process.pid)
    code = process.wait()
    seconds = time.perf_counter() - start
    if code:
        raise RuntimeError(f"'{' '.join(command)}' ended with code {code}.")
    n = len(list(output.rglob("object.ply")))
    size = sum(path.stat().st_size for path in output.rglob("*") if path.is_file())
    shutil.rmtree(output)
    return {
        "engine": engine, "workers": workers, "items": n, "seconds": seconds, "items_per_minute": 60 * n / seconds,
        "peak_bytes": peak.end(), "output_bytes": size,
    }  # fmt: skip


class _Peak:
    """The largest memory of a process and all that it started, without counting what they share twice."""

    def __init__(self, process: int) -> None:
        self._process, self._bytes, self._ended = process, 0, threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()

    def end(self) -> int:
        """The peak so far, in bytes."""
        self._ended.set()
        self._thread.join()
        return self._bytes

    def _watch(self) -> None:
        while not self._ended.wait(_SAMPLE_PAUSE):
            self._bytes = max(self._bytes, sum(map(_memory_of, _family(self._process))))


def _family(process: int) -> Iterator[int]:
    parents: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError):
            continue
        parents.setdefault(parent, []).append(int(path.parent.name))
    waiting = [process]
    while waiting:
        number = waiting.pop()
        yield number
        waiting += parents.get(number, [])


def _memory_of(process: int) -> int:
    try:
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError):
        pass
    return 0


def loop_over(manifest: Path, output: Path) -> None:
    """What a batch is held against: a loop over the items, with each scene read once."""
    import gaussian_trimmer as gt

    scene, path = None, ""
    for row in csv.DictReader(manifest.open(encoding="utf-8")):
        if row["scene"] != path:
            scene, path = gt.read(manifest.parent / row["scene"]), row["scene"]
        assert scene is not None
        rough, up = gt.read_selection(manifest.parent / row["selection"], scene), tuple(map(float, row["up"].split()))
        gt.save(gt.trim(scene, rough, up=up), output / row["name"])


if __name__ == "__main__":
    if sys.argv[1:2] == ["--loop-over"]:
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")
        loop_over(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
