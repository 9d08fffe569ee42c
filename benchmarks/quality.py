"""How good are the trims? Every scene x object x kind of rough selection, before and after, against ground truth.

    python benchmarks/quality.py [ROOT] [--variants default paper sagd ...] [--without-cameras] [--output DIR]

ROOT holds benchmark scenes (see `gaussian_trimmer.evaluation.datasets`); without it, those that come with the
repository are measured. This is `gaussian-trimmer evaluate benchmark`, whose --help lists the options.
"""

from __future__ import annotations

import sys
from pathlib import Path

from gaussian_trimmer.cli import main

DATA = Path(__file__).parent / "data"


def run(arguments: list[str]) -> int:
    """The exit code of the command."""
    named = arguments and not arguments[0].startswith("-")
    return main(["evaluate", "benchmark", *([] if named else [str(DATA)]), *arguments])


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
