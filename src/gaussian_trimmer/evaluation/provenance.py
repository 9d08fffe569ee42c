"""What made a table: the program's version and commit."""

from __future__ import annotations

import json
import subprocess
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path

from gaussian_trimmer._version import __version__


@cache
def made_by() -> str:
    """Return the program's version and, where it is known, the commit."""
    return f"made by gaussian-trimmer {__version__}{f', commit {commit}' if (commit := _commit()) else ''}"


def _commit() -> str | None:
    """Return the commit of the checkout that is used, or that pip installed from."""
    checkout = Path(__file__).resolve().parents[3]
    if (checkout / ".git").exists():
        command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        with suppress(OSError, subprocess.SubprocessError):
            return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    with suppress(metadata.PackageNotFoundError, ValueError, KeyError, TypeError):
        url = json.loads(metadata.distribution("gaussian-trimmer").read_text("direct_url.json") or "")
        return str(url["vcs_info"]["commit_id"])[:12]
    return None
