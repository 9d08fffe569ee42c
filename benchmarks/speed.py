"""What do people wait for, and where does a trim spend its time?

    python benchmarks/speed.py [--against COMMIT] [--data ROOT --objects NAME ...] [--runs 5] [--first-run]
    python benchmarks/speed.py --section captures --capture FILE --at X Y Z --reach R --up X Y Z [--against COMMIT]
    python benchmarks/speed.py --section stages [--scene SCENE.ply --selection FILE] [--sizes 80000 1000000]

Whatever is measured runs in a process of its own, one after another, so that nothing is inherited: neither compiled
code, nor caches, nor memory. The method is described in docs/speed.md.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import resource
import sys
import time
from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib import metadata
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import waits
from quality import parser_of
from synthetic_scenes import tiled

from gaussian_trimmer import formats, sample
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.virtual_cameras import PlanConfig

Record = dict[str, Any]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--section", choices=("waits", "captures", "stages"), default="waits", help="what to measure")
    parser.add_argument("--runs", type=int, default=5, help="runs, or pairs of runs, of which the median is taken")
    parser.add_argument("--against", default="", help="waits, captures: a commit to compare with, in pairs")
    parser.add_argument("--data", type=Path, default=Path(__file__).parent / "data" / "tabletop",
                        help="waits: folder of a benchmark scene")  # fmt: skip
    parser.add_argument("--objects", nargs="+", default=["mug", "robot"], help="waits: a small and a large one")
    parser.add_argument("--first-run", action="store_true", help="waits: also the first run after an installation")
    parser.add_argument("--capture", type=Path, default=sample.SCENE, help="captures: splat file of a whole capture")
    parser.add_argument("--at", nargs=3, type=float, default=(0.0, 0.0, 0.0), help="captures: middle of a thing in it")
    parser.add_argument("--reach", type=float, default=0.5, help="captures: half the thing's size, in scene units")
    parser.add_argument("--copies", nargs="+", type=int, default=waits.SIZES,
                        help="captures: numbers of Gaussians of copies of the capture side by side")  # fmt: skip
    parser.add_argument("--scene", type=Path, default=sample.SCENE, help="stages: splat file of the scene")
    parser.add_argument("--selection", type=Path, default=sample.SELECTION, help="stages: a selection in it")
    parser.add_argument("--sizes", nargs="+", type=int, default=[0], help="stages: numbers of Gaussians of enlarged "
                        "scenes; 0 is the scene as it is")  # fmt: skip
    parser.add_argument("--pixels", type=int, default=PlanConfig.size, help="stages: width of the views")
    parser.add_argument("--up", nargs=3, type=float, help="captures (z without it), stages: up vector of the scene")
    parser.add_argument("--output", type=Path, default=Path("out/speed"), help="folder for speed.json")
    options = parser.parse_args()
    records = list[Record]()
    for record in SECTIONS[options.section](options):
        print(", ".join(f"{name} {_cell(name, value)}" for name, value in record.items()), flush=True)
        records.append(record)
    options.output.mkdir(parents=True, exist_ok=True)
    results = {"machine": _machine(), options.section: records}
    (options.output / "speed.json").write_text(json.dumps(results, indent=1) + "\n")


def waits_section(options: Namespace) -> Iterator[Record]:
    left_out = () if options.first_run else ("first run",)
    return waits.measure(options.data, options.objects, options.runs, options.against, left_out)


def captures_section(options: Namespace) -> Iterator[Record]:
    thing = {"at": options.at, "reach": options.reach, "up": options.up or (0.0, 0.0, 1.0)}
    return waits.measure_capture(options.capture, thing, options.copies, options.runs, options.against)


def stages_section(options: Namespace) -> Iterator[Record]:
    up = tuple(options.up) if options.up else None
    for size in options.sizes:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            config = TrimConfig(up=up, plan=PlanConfig(size=options.pixels))
            case = options.scene.absolute(), options.selection.absolute(), size, config, options.runs
            yield pool.submit(stages_of_a_trim, *case).result()


def stages_of_a_trim(scene_path: Path, selection_path: Path, size: int, config: TrimConfig, runs: int) -> Record:
    """Seconds by stage, medians of runs after a first one that is not counted."""
    scene = formats.read(scene_path)
    selection = load_selection(selection_path, scene)
    if size:
        scene, selection = tiled(scene, selection, size)
    stages, result = list[dict[str, float]](), trim(scene, selection, config=config)
    for _ in range(runs):
        start = time.perf_counter()
        result = trim(scene, selection, config=config)
        made = len(result.background)
        stages.append({**result.seconds, "trim": time.perf_counter() - start})
    seconds = {name: float(np.median([stage[name] for stage in stages])) for name in stages[0]}
    unit = 1 if sys.platform == "darwin" else 1024  # Linux counts in kilobytes, macOS in bytes
    peak = unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    digest = hashlib.sha256(result.object.means.tobytes() + result.background.means.tobytes()).hexdigest()
    return {
        "gaussians": len(scene),
        "selected": int(selection.sum()),
        "background": made,
        **seconds,
        "peak_bytes": peak,
        "digest": digest[:8],
    }


SECTIONS = {"waits": waits_section, "captures": captures_section, "stages": stages_section}


def _machine() -> Record:
    installed = {name: metadata.version(name) for name in ("numpy", "numba")}
    return {"platform": platform.platform(), "cores": os.cpu_count(), "python": platform.python_version(), **installed}


def _cell(name: str, value: Any) -> str:
    if name.endswith("bytes") and value:
        return f"{value / 1e6:.0f} MB"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
