"""What does a trim cost? Time by stage, warm and from a shell, peak memory, and how both grow.

    python benchmarks/speed.py [--sections warm kernel ...] [--scene SCENE.ply --selection FILE] [--output DIR]

Whatever is measured runs in a process of its own, one after another, so that nothing is inherited: neither compiled
code, nor caches, nor memory. The method is described in docs/speed.md.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from measures import (
    Case,
    Record,
    cuda_device,
    in_new_process,
    measure_host,
    measure_kernel,
    measure_trim,
    medians,
    run_command,
)
from rich.console import Console
from rich.table import Table
from synthetic_scenes import tiled, with_object_of
from tyro.conf import arg

from gaussian_trimmer import formats, sample
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.planning.virtual_cameras import PlanConfig
from gaussian_trimmer.rendering import RENDERER_CHOICES
from gaussian_trimmer.segmentation.segmenters import DEFAULT_SEGMENTER, SEGMENTERS
from gaussian_trimmer.selection_files import load_selection

Section = Literal["warm", "cold", "sizes", "objects", "views", "resolutions", "kernel", "threads", "avx2", "host"]
Change = Callable[[Gaussians, BoolArray, int], tuple[Gaussians, BoolArray]]
STAGES = ("load", "plan", "render", "correct", "segment", "weigh", "prune", "split", "assemble", "trim", "save")

# The processor's name alone would leave Numba the features of the real one, AVX-512 among them.
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}


@dataclass(frozen=True)
class Arguments:
    """Measure what trims cost."""

    scene: Path = sample.SCENE
    """Splat file of the scene."""
    selection: Path = sample.SELECTION
    """Coarse selection of one object in it."""
    up: tuple[float, float, float] | None = None
    """Up vector of the scene; not given: found, which takes time too."""
    sections: tuple[Section, ...] = ("warm", "cold", "kernel")
    """What to measure; `sizes`, `objects`, `views` and `resolutions` are the sweeps that are plotted."""
    sizes: tuple[int, ...] = (80_000, 1_000_000, 3_000_000)
    """Numbers of Gaussians of enlarged scenes; the object and what surrounds it stay the same. Sizes below that of the
    scene itself stand for the scene itself."""
    object_sizes: tuple[int, ...] = (1_000, 4_000, 16_000, 64_000)
    """Numbers of Gaussians of the selected object."""
    views: tuple[int, ...] = (1, 3, 5, 10)
    """Numbers of views."""
    resolutions: tuple[int, ...] = (256, 512, 1024)
    """Widths of the views in pixels."""
    threads: tuple[int, ...] = (1, 2, 8)
    """Numbers of threads."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = "numba"
    """What renders the views."""
    pixels: int = PlanConfig.size
    """Width of the views in pixels, where the section does not vary it."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """What segments the views."""
    sam2_model: str = ""
    """With `sam2`: a model on the hub or a local folder. Not given: SAM2.1 large with random weights, which costs as
    much as the trained one; its masks mean nothing, so later stages get those of the default segmenter. Sections
    that run the command, `cold` among them, then cannot be measured."""
    runs: int = 5
    """Runs of which the median is taken."""
    first_run: bool = False
    """With `cold`: also run the command as after an installation, without compiled kernels."""
    output: Path = Path("out/speed")
    """Folder for speed.json and speed.png."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    if arguments.segmenter == "sam2" and not arguments.sam2_model and {"cold", "sizes"} & set(arguments.sections):
        sys.exit("The sections cold and sizes run the command, which needs trained weights: pass --sam2-model.")
    console = Console()
    results: Record = {"machine": _machine()}
    with tempfile.TemporaryDirectory(prefix="speed-") as name:
        config = TrimConfig(up=arguments.up, plan=PlanConfig(size=arguments.pixels))
        base = Case(
            arguments.scene.absolute(),
            arguments.selection.absolute(),
            config,
            arguments.renderer,
            arguments.segmenter,
            arguments.sam2_model,
            arguments.runs,
        )
        for section in dict.fromkeys(arguments.sections):
            results[section] = SECTIONS[section](base, arguments, Path(name))
            console.print(_table(section, results[section]))
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "speed.json").write_text(json.dumps(results, indent=1) + "\n")
    if plotted := [section for section in SWEEPS if section in results]:
        _plot(results, plotted, arguments.output / "speed.png")


# Sections: each gives records of what was varied and what was measured.


def warm_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    return [in_new_process(measure_trim, base)]


def cold_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    run_command(base, folder)  # leaves compiled kernels
    runs = [run_command(base, folder) for _ in range(base.runs)]
    records: list[Record] = [{"kernels": "cached", **medians(runs)}]
    if arguments.first_run:
        with tempfile.TemporaryDirectory(dir=folder) as empty:
            records.append({"kernels": "compiled", **run_command(base, folder, {"NUMBA_CACHE_DIR": empty})})
    return records


def sizes_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    records = []
    for n in arguments.sizes:
        with _made(base, folder, tiled, n) as case:
            command = run_command(case, folder)
            record = in_new_process(measure_trim, case)
            records.append({**record, "command": command["command"], "peak_bytes": command["peak_bytes"]})
    return records


def objects_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    records = []
    for n in arguments.object_sizes:
        with _made(base, folder, with_object_of, n) as case:
            records.append(in_new_process(measure_trim, case))
    return records


def views_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    return [{"views": n, **in_new_process(measure_trim, _planned(base, views=n))} for n in arguments.views]


def resolutions_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    return [{"pixels": n, **in_new_process(measure_trim, _planned(base, size=n))} for n in arguments.resolutions]


def kernel_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    return [in_new_process(measure_kernel, base.runs)]


def threads_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    records = []
    for n in arguments.threads:
        environment = {"NUMBA_NUM_THREADS": str(n)}
        kernel = in_new_process(measure_kernel, base.runs, environment=environment)
        trimmed = in_new_process(measure_trim, base, environment=environment)
        records.append({"threads": n, **kernel, **trimmed})
    return records


def avx2_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    with tempfile.TemporaryDirectory(dir=folder) as cache:
        environment = {**AVX2, "NUMBA_CACHE_DIR": cache}
        kernel = in_new_process(measure_kernel, base.runs, environment=environment)
        return [{**kernel, **in_new_process(measure_trim, base, environment=environment)}]


def host_section(base: Case, arguments: Arguments, folder: Path) -> list[Record]:
    return [in_new_process(measure_host, _planned(base, size=n)) for n in arguments.resolutions]


SECTIONS: dict[str, Callable[[Case, Arguments, Path], list[Record]]] = {
    "warm": warm_section,
    "cold": cold_section,
    "sizes": sizes_section,
    "objects": objects_section,
    "views": views_section,
    "resolutions": resolutions_section,
    "kernel": kernel_section,
    "threads": threads_section,
    "avx2": avx2_section,
    "host": host_section,
}
SWEEPS = {
    "sizes": ("gaussians", "Gaussians of the scene"),
    "objects": ("selected", "Gaussians of the object"),
    "views": ("views", "number of views"),
    "resolutions": ("pixels", "pixels across a view"),
}

TOTAL_STYLE = {"marker": "o", "color": "black", "linewidth": 2.5}


def _planned(case: Case, **settings: int) -> Case:
    plan: PlanConfig = replace(case.config.plan, **settings)  # type: ignore[arg-type]
    return replace(case, config=replace(case.config, plan=plan))


@contextmanager
def _made(base: Case, folder: Path, change: Change, n: int) -> Iterator[Case]:
    """The base case with another scene, whose files are deleted in the end."""
    case = replace(base, scene=folder / f"{n}.ply", selection=folder / f"{n}.npy")
    in_new_process(_make, base, case, change, n)
    try:
        yield case
    finally:
        case.scene.unlink()
        case.selection.unlink()


def _make(base: Case, case: Case, change: Change, n: int) -> None:
    scene = formats.read(base.scene)
    made, selected = change(scene, load_selection(base.selection, scene), n)
    formats.write(made, case.scene)
    np.save(case.selection, selected)


# Reports.


def _machine() -> Record:
    installed = {name: _version(name) for name in ("numpy", "numba", "torch", "gsplat", "transformers")}
    return {
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **installed,
        **in_new_process(cuda_device),
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _table(section: str, records: Sequence[Record]) -> Table:
    """One column a record, one row a figure; what was varied comes first."""
    table = Table(title=section, show_header=False)
    for name in dict.fromkeys(name for record in records for name in record):
        table.add_row(name.replace("_", " "), *(_cell(name, record.get(name, "")) for record in records))
    for column in table.columns[1:]:
        column.justify = "right"
    return table


def _cell(name: str, value: Any) -> str:
    if name.endswith("bytes") and value:
        return f"{value / 1e6:.0f} MB"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _plot(results: Record, sections: Sequence[str], path: Path) -> None:
    """Seconds against what was varied, one panel a sweep."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5 * len(sections), 4), layout="constrained")
    panels = figure.subplots(1, len(sections), squeeze=False)[0]
    for panel, section in zip(panels, sections, strict=True):
        name, label = SWEEPS[section]
        records = sorted(results[section], key=lambda record: record[name])
        x = [record[name] for record in records]
        for stage in STAGES:
            seconds = [record.get(stage, 0.0) for record in records]
            panel.plot(x, seconds, **(TOTAL_STYLE if stage == "trim" else {"marker": "o"}), label=stage)
        panel.set(xlabel=label, ylabel="seconds", ylim=(0, None), xscale="linear" if name == "views" else "log")
        panel.grid(alpha=0.3)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
