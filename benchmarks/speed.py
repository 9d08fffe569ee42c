"""What do people wait for, and where does a trim spend its time?

    python benchmarks/speed.py [--against COMMIT] [--data ROOT --objects NAME ...] [--runs 5] [--first-run]
    python benchmarks/speed.py --sections stages kernel threads [--scene SCENE.ply --selection FILE]
    python benchmarks/speed.py --sections captures --capture FILE --at X Y Z --reach R --up X Y Z [--against COMMIT]

Whatever is measured runs in a process of its own, one after another, so that nothing is inherited: neither compiled
code, nor caches, nor memory. The method is described in docs/speed.md.
"""

from __future__ import annotations

import json
import os
import platform
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
import waits
import whole_captures
from measures import Case, Record, cuda_device, in_new_process, measure_kernel, measure_trim, run_command
from rich.console import Console
from rich.table import Table
from synthetic_scenes import tiled
from tyro.conf import arg

from gaussian_trimmer import formats, sample
from gaussian_trimmer.masks import DEFAULT_SEGMENTER, SEGMENTERS
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.views.virtual_cameras import PlanConfig

Section = Literal["waits", "captures", "stages", "kernel", "threads", "sizes"]


@dataclass(frozen=True)
class Arguments:
    """Measure speed and memory."""

    sections: tuple[Section, ...] = ("waits",)
    """What to measure."""
    runs: int = 5
    """Runs, or pairs of runs, of which the median is taken."""
    data: Path = Path(__file__).parent / "data" / "tabletop"
    """`waits`: folder of a benchmark scene."""
    objects: tuple[str, ...] = ("mug", "robot")
    """`waits`: a small and a large object of it."""
    against: str = ""
    """`waits`, `captures`: a commit with which this version is compared in pairs."""
    first_run: bool = False
    """`waits`: also measure the first run after an installation, in which kernels are compiled."""
    capture: Path = sample.SCENE
    """`captures`: splat file of a whole capture."""
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """`captures`: middle of a thing in it."""
    reach: float = 0.5
    """`captures`: half the size of the thing, in scene units."""
    copies: tuple[int, ...] = whole_captures.SIZES
    """`captures`: numbers of Gaussians of copies of the capture side by side."""
    scene: Path = sample.SCENE
    """Other sections: splat file of the scene."""
    selection: Path = sample.SELECTION
    """Other sections: rough selection of one object in it."""
    up: tuple[float, float, float] | None = None
    """`captures`, other sections: up vector of the scene; not given: z in `captures`, found, which takes time too, in
    the others."""
    sizes: tuple[int, ...] = (80_000, 1_000_000, 3_000_000)
    """`sizes`: numbers of Gaussians of enlarged scenes."""
    pixels: tuple[int, ...] = (PlanConfig.size,)
    """Other sections: widths of the views."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """Other sections: what segments the views."""
    sam2_model: str = ""
    """With `sam2`: a model on the hub or a local folder."""
    output: Path = Path("out/speed")
    """Folder for speed.json."""


def main() -> None:
    arguments = tyro.cli(Arguments)
    console = Console()
    results: Record = {"machine": _machine()}
    for section in dict.fromkeys(arguments.sections):
        results[section] = SECTIONS[section](arguments)
        console.print(_table(section, results[section]))
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "speed.json").write_text(json.dumps(results, indent=1) + "\n")


# Sections: each gives records of what was varied and what was measured.


def waits_section(arguments: Arguments) -> list[Record]:
    left_out = () if arguments.first_run else ("first run",)
    chosen = arguments.data, arguments.objects, arguments.runs, arguments.against, left_out
    return _told_one_by_one(waits.measure(*chosen))


def captures_section(arguments: Arguments) -> list[Record]:
    up = arguments.up or (0.0, 0.0, 1.0)
    thing = arguments.capture, arguments.at, arguments.reach, up
    return _told_one_by_one(whole_captures.measure(*thing, arguments.copies, arguments.runs, arguments.against))


def stages_section(arguments: Arguments) -> list[Record]:
    return [in_new_process(measure_trim, case) for case in _cases(arguments)]


def kernel_section(arguments: Arguments) -> list[Record]:
    return [in_new_process(measure_kernel, arguments.runs)]


def threads_section(arguments: Arguments) -> list[Record]:
    records = []
    for n in (1, 2, 8):
        environment = {"NUMBA_NUM_THREADS": str(n)}
        kernel = in_new_process(measure_kernel, arguments.runs, environment=environment)
        trimmed = in_new_process(measure_trim, _cases(arguments)[0], environment=environment)
        records.append({"threads": n, **kernel, **trimmed})
    return records


def sizes_section(arguments: Arguments) -> list[Record]:
    records = []
    with tempfile.TemporaryDirectory(prefix="speed-") as name:
        for n in arguments.sizes:
            folder = Path(name)
            case = replace(_cases(arguments)[0], scene=folder / f"{n}.ply", selection=folder / f"{n}.npy")
            in_new_process(_enlarge, arguments.scene, arguments.selection, case, n)
            command = run_command(case, folder)
            record = in_new_process(measure_trim, case)
            records.append({**record, "command": command["command"], "peak_bytes": command["peak_bytes"]})
            case.scene.unlink()
    return records


SECTIONS: dict[str, Callable[[Arguments], list[Record]]] = {
    "waits": waits_section,
    "captures": captures_section,
    "stages": stages_section,
    "kernel": kernel_section,
    "threads": threads_section,
    "sizes": sizes_section,
}


def _cases(arguments: Arguments) -> list[Case]:
    """The trim to measure, with views of each width."""
    return [
        Case(
            arguments.scene.absolute(),
            arguments.selection.absolute(),
            TrimConfig(up=arguments.up, plan=PlanConfig(size=pixels)),
            arguments.segmenter,
            arguments.sam2_model,
            arguments.runs,
        )
        for pixels in arguments.pixels
    ]


def _enlarge(scene_path: Path, selection_path: Path, case: Case, n: int) -> None:
    scene = formats.read(scene_path)
    made, selected = tiled(scene, load_selection(selection_path, scene), n)
    formats.write(made, case.scene)
    np.save(case.selection, selected)


# Reports.


def _told_one_by_one(measured: Iterable[Record]) -> list[Record]:
    """The records, each printed as soon as it is there."""
    records = []
    for record in measured:
        print(", ".join(f"{name} {_cell(name, value)}" for name, value in record.items()), flush=True)
        records.append(record)
    return records


def _machine() -> Record:
    installed = {name: _version(name) for name in ("numpy", "numba", "torch", "transformers")}
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
    """A row for each wait; in other sections a column for each record, and a row for each figure."""
    if section in ("waits", "captures"):
        table = Table(*records[0], title="seconds, and the median ratio of pairs")
        for record in records:
            table.add_row(*(_cell(name, record.get(name, "")) for name in records[0]))
    else:
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


if __name__ == "__main__":
    main()
