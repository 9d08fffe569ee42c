"""Where benchmark scenes and real captures are found; a test that needs one that is nowhere is skipped.

Folders are searched in this order: the one that the environment variable GAUSSIAN_TRIMMER_BENCHMARKS names,
`../shared/data` beside the project, and the scenes that the project itself has, `benchmarks/data`.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from benchmark_scenes import BenchmarkScene, find_scenes, open_scene

VARIABLE = "GAUSSIAN_TRIMMER_BENCHMARKS"
_PROJECT = Path(__file__).parents[1]

OWN = _PROJECT / "benchmarks" / "data"
"""The scenes that the project itself has."""

__all__ = ["OWN", "BenchmarkScene", "benchmark_scene", "find", "find_scenes", "open_scene"]


def find(name: str) -> Path:
    """The file or folder of that name, such as `scene0` or `real/seal.ply`; skips the test if there is none."""
    named = os.environ.get(VARIABLE)
    if named and not Path(named).is_dir():
        pytest.fail(f"{VARIABLE} is '{named}', which is no folder.")
    roots = [Path(named)] if named else []
    for root in (*roots, _PROJECT.parent / "shared" / "data", OWN):
        if (root / name).exists():
            return root / name
    pytest.skip(f"no {name} among the benchmark data; {VARIABLE} can name a folder that has it")


def benchmark_scene(name: str) -> BenchmarkScene:
    """The benchmark scene of that name, opened; skips the test if there is none."""
    return open_scene(find(name))
