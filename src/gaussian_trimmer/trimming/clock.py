"""How long each stage of a trim takes, and who is told when one begins."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str], None]
"""Called with the name of each stage when it begins."""
LOG = logging.getLogger("gaussian_trimmer")


class Clock:
    """Adds up the time that each stage takes, over all its parts, and announces each part when it begins.

    Args:
        progress: told of each stage and part.
        log: where each stage is also logged; None: nowhere.
    """

    def __init__(self, progress: Progress, log: logging.Logger | None = LOG) -> None:
        self.seconds: dict[str, float] = {}
        self._progress, self._log = progress, log

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time what runs within, as a part of a stage."""
        if self._log is not None:
            self._log.info("stage: %s", stage)
        self._progress(stage)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start

    def part(self, name: str) -> None:
        """Announce a part of the stage that is running, as in "segment 2 of 5"."""
        self._progress(name)
