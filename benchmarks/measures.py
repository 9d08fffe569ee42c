"""What `speed.py` measures: a trim in Python, the command, and the steps of drawing; each in its own process."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from synthetic_scenes import KERNEL_SIZE, kernel_view

from gaussian_trimmer import formats
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.masks import Segmenter, get_segmenter
from gaussian_trimmer.masks.sam2_video import Sam2Config
from gaussian_trimmer.rendering import blend_weights, render
from gaussian_trimmer.rendering.tile_renderer import project_view
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.trim import trim

Record = dict[str, Any]
Result = TypeVar("Result")


@dataclass(frozen=True)
class Case:
    """One trim to measure."""

    scene: Path
    selection: Path
    config: TrimConfig
    segmenter: str
    sam2_model: str
    """Folder or hub name of the model of `sam2`."""
    runs: int


def in_new_process(
    function: Callable[..., Result], *arguments: Any, environment: Mapping[str, str] | None = None
) -> Result:
    """What a function returns in a fresh interpreter, with more environment variables.

    On Linux a process's peak memory begins at that of its parent, so this one must stay small: scenes are made in
    processes of their own too.
    """
    with _environment(environment or {}), ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def measure_trim(case: Case) -> Record:
    """Seconds by stage, medians of runs after a first one that is not counted; run in a process of its own."""
    scene = formats.read(case.scene)
    selection = load_selection(case.selection, scene)
    loads = [_seconds(lambda: formats.read(case.scene)) for _ in range(case.runs)]
    segmenter = _segmenter(case)
    result, _ = _timed_trim(scene, selection, case.config, segmenter)
    stages = []
    for _ in range(case.runs):
        result, seconds = _timed_trim(scene, selection, case.config, segmenter)
        stages.append(seconds)
    return {
        "gaussians": len(scene),
        "selected": int(selection.sum()),
        "load": float(np.median(loads)),
        **medians(stages),
        "save": _save_seconds(result),
        "peak_bytes": _peak_bytes(),
        **_device_memory(),
        "file_bytes": case.scene.stat().st_size,
        "digest": _digest(result)[:8],
        "refused": bool(result.refused),
    }


def _timed_trim(
    scene: Gaussians, selection: BoolArray, config: TrimConfig, segmenter: Segmenter
) -> tuple[TrimResult, dict[str, float]]:
    """A trim, and its seconds by stage and in all."""
    start = time.perf_counter()
    result = trim(scene, selection, config=config, segmenter=segmenter)
    return result, {**result.seconds, "trim": time.perf_counter() - start}


def _segmenter(case: Case) -> Segmenter:
    if case.segmenter != "sam2":
        return get_segmenter(case.segmenter)
    return get_segmenter("sam2", Sam2Config(model=case.sam2_model))


def measure_kernel(runs: int) -> Record:
    """Milliseconds of the steps of drawing a random view, medians; run in a process of its own."""
    gaussians, camera, pairs = kernel_view()
    labels = (np.arange(KERNEL_SIZE**2).reshape(KERNEL_SIZE, -1) // 100 % 2).astype(np.uint8)
    steps: dict[str, Callable[[], Any]] = {
        "project_ms": lambda: project_view(gaussians, camera),
        "colour_ms": lambda: render(gaussians, camera),
        "weights_ms": lambda: blend_weights(gaussians, camera, labels, 2),
    }
    record: Record = {"pairs": pairs}
    for name, step in steps.items():
        step()  # compiles, and keeps the projection
        record[name] = 1e3 * float(np.median([_seconds(step) for _ in range(max(runs, 15))]))
    record["colour_ns_per_pair"] = 1e6 * record["colour_ms"] / pairs
    record["weights_ns_per_pair"] = 1e6 * record["weights_ms"] / pairs
    record["weights_over_colour"] = record["weights_ms"] / record["colour_ms"]
    return record


def run_command(case: Case, folder: Path, environment: Mapping[str, str] | None = None) -> Record:
    """Seconds and peak memory of the command line, from the start of the interpreter to its end."""
    with tempfile.TemporaryDirectory(dir=folder) as output:
        command = [sys.executable, "-m", "gaussian_trimmer", "trim", str(case.scene), str(case.selection)]
        command += ["--output", f"{output}/trimmed", "--quiet"]
        command += ["--plan.size", str(case.config.plan.size)]
        command += ["--segmenter", case.segmenter]
        if case.sam2_model:
            command += ["--sam2.model", case.sam2_model]
        if case.config.up:
            command += ["--up", *map(str, case.config.up)]
        start = time.perf_counter()
        process = subprocess.Popen(command, env={**os.environ, **(environment or {})})
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"'{' '.join(command)}' ended with code {process.returncode}.")
    return {"command": seconds, "peak_bytes": _in_bytes(usage.ru_maxrss), "file_bytes": case.scene.stat().st_size}


def _seconds(step: Callable[[], Any]) -> float:
    start = time.perf_counter()
    step()
    return time.perf_counter() - start


def _save_seconds(result: TrimResult) -> float:
    """All that the command writes: object and background, labels, pictures and report."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        result.save(folder)
        return time.perf_counter() - start


def medians(runs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The median of each entry."""
    return {name: float(np.median([run[name] for run in runs])) for name in runs[0]}


def _peak_bytes() -> int:
    import resource

    return _in_bytes(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def cuda_device() -> Record:
    """Name of the CUDA device and version of CUDA, if PyTorch finds one; run in a process of its own."""
    try:
        torch = import_module("torch")
    except ImportError:
        return {}
    return {"device": torch.cuda.get_device_name(), "cuda": torch.version.cuda} if torch.cuda.is_available() else {}


def _device_memory() -> Record:
    """Largest memory of PyTorch's tensors on a CUDA device, where there is one and this process uses it."""
    torch = sys.modules.get("torch")
    return {"device_bytes": torch.cuda.max_memory_allocated()} if torch and torch.cuda.is_available() else {}


def _in_bytes(maximum_resident: int) -> int:
    """Linux counts in kilobytes, macOS in bytes."""
    return maximum_resident if sys.platform == "darwin" else 1024 * maximum_resident


def _digest(result: TrimResult) -> str:
    """A name for the exact result."""
    arrays = [result.only.source_index, result.only.label, result.background_source, result.background_label]
    arrays += [part.means for part in (result.object, result.appended)]
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()
