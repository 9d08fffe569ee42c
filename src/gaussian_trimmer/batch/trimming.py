"""Trims items of one scene and writes the results of each, or why it failed: the work of a batch, wherever it runs."""

from __future__ import annotations

import faulthandler
import itertools
import json
import os
import signal
import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.batch.fingerprints import digest_of_cameras, digest_of_file, fingerprint
from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.outcomes import Outcome, earlier_outcome, outcome_of
from gaussian_trimmer.batch.storage import ITEM, Store
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import FolderInUseError, InputError, printable, user_message
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.stop_signals import Stopped, stop_signals_raised
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.output.result import TrimResult
from gaussian_trimmer.output.saving import write_results
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters import get_segmenter
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.trimming.arguments import refuse_whole_scene
from gaussian_trimmer.trimming.options import views_of_masks
from gaussian_trimmer.trimming.trim import trim

_SECONDS_BETWEEN_LOOKS = 0.5
_SECONDS_TO_COMPILE = 300.0
"""What the first item of a process is granted beyond the time limit."""
_SECONDS_TO_STOP = 10.0
_tried = itertools.count()
"""Counts the items that this process has tried."""


def trim_items(
    items: Sequence[Item], output: Path, *, retry_failed: bool = False, time_limit: float | None = None
) -> list[Outcome]:
    """What becomes of items of one scene, which is read once; what an earlier run has finished is not done again.

    An item that another run is writing comes after the others, when it may be finished.

    Args:
        items: what to trim.
        output: folder of the results.
        retry_failed: try those items again that failed in an earlier run.
        time_limit: seconds that one item may take.
    """
    store, scene = Store(output), _Scene(items[0].scene, items[0].level)
    outcomes, waiting = list[Outcome](), deque(items)
    while waiting:
        item = waiting.popleft()
        outcome = _outcome(item, scene, store, retry_failed, time_limit)
        if outcome is None:
            waiting.append(item)
            time.sleep(_SECONDS_BETWEEN_LOOKS)
        else:
            outcomes.append(outcome)
    return outcomes


def _outcome(item: Item, scene: _Scene, store: Store, retry_failed: bool, limit: float | None) -> Outcome | None:
    """What becomes of an item, whatever goes wrong; None if another run is writing it."""
    mark, details, writing = "", "", False
    try:
        with _interruptible(limit):
            mark = scene.fingerprint(item)
            earlier = earlier_outcome(store, item, mark)
            if earlier is not None and not (earlier.state == "failed" and retry_failed):
                store.clean(item.name)
                return earlier
            gaussians, start, writing = scene.gaussians, time.perf_counter(), True
            with store.result_folder(item.name, item.suffix, scene.input_files(item)) as folder:
                writing = False
                if (told := store.finished(item.name)) is not None and told["fingerprint"] == mark:
                    raise _FinishedByAnotherRun(told)
                result = trim_item(gaussians, _selection(gaussians, item), item, scene.cameras(item))
                writing = True
                told = _write(result, item, mark, folder)
            seconds = time.perf_counter() - start
        store.forget_failure(item.name)
        return outcome_of(item, told, seconds, fresh=True)
    except _FinishedByAnotherRun as other:
        return outcome_of(item, other.told)
    except _TookTooLong:
        message = f"It took longer than the time limit of {limit:g} seconds."
    except FolderInUseError:
        return None
    except (InputError, OSError, MemoryError) as error:
        message = user_message(error) or ""
        if _is_of_machine(error):
            mark = ""  # The next run tries again what the machine is to blame for.
            if writing:
                return Outcome(item, "failed", message, unwritten=True)
    except Exception as error:  # A defect of the program must not stop the other items.
        details = traceback.format_exc()
        message = printable(f"A defect of the program: {type(error).__name__}: {error}", 1000)
    store.record_failure(item.name, message, mark, details)
    return Outcome(item, "failed", message, fingerprint=mark)


class _Scene:
    """A scene, with what else its items have in common, each read when it is first needed."""

    def __init__(self, path: str, level: int | None) -> None:
        self._given, self._level = Path(path), level
        self._cameras: dict[tuple[str, bool], CameraSet] = {}
        self._digests: dict[str, str] = {}

    @cached_property
    def path(self) -> Path:
        """The splat file."""
        return formats.find_scene(self._given)

    @cached_property
    def gaussians(self) -> Gaussians:
        """The Gaussians of the scene."""
        return formats.read(self.path, level=self._level)

    def cameras(self, item: Item) -> CameraSet | None:
        """The cameras of an item, if it has some."""
        if item.cameras is None:
            return None
        key = item.cameras, item.trust_paths
        if key not in self._cameras:
            self._cameras[key] = read_cameras_of(self._given, Path(item.cameras), trust_paths=item.trust_paths)
        return self._cameras[key]

    def fingerprint(self, item: Item) -> str:
        """The digest of an item and its inputs."""
        cameras = self.cameras(item)
        return fingerprint(
            item,
            " ".join(self._digest(str(path)) for path in formats.scene_files(self.path, self._level)),
            self._digest(item.selection) if item.selection else None,
            digest_of_cameras(cameras) if cameras else None,
        )

    def input_files(self, item: Item) -> list[Path]:
        """The files that an item is made from."""
        return [Path(p) for p in (item.selection, str(self.path), item.cameras) if p and Path(p).is_file()]

    def _digest(self, path: str) -> str:
        if path not in self._digests:
            self._digests[path] = digest_of_file(Path(path))
        return self._digests[path]


def _selection(scene: Gaussians, item: Item) -> BoolArray:
    if item.selection is None:
        return np.ones(len(scene), np.bool_)
    selection = load_selection(Path(item.selection), scene, item.selection_options)
    refuse_whole_scene(selection, item.selection, item.scene)
    return selection


def trim_item(scene: Gaussians, selection: BoolArray, item: Item, cameras: CameraSet | None) -> TrimResult:
    """Trim an item of a scene as `gaussian-trimmer trim` does.

    Raises:
        InputError: the item cannot be trimmed.
    """
    options = [] if item.segmenter_options is None else [item.segmenter_options]
    segmenter = get_segmenter(item.segmenter, *options)
    return trim(
        scene,
        selection,
        config=item.config,
        renderer=get_renderer(item.renderer),
        segmenter=segmenter,
        cameras=cameras,
        view_cameras=views_of_masks(segmenter, cameras, item.config),
    )


def _write(result: TrimResult, item: Item, mark: str, folder: Path) -> dict[str, Any]:
    """Write the files of an item; returns what `item.json` says."""
    report = describe(result, _inputs(item))
    del report["seconds"]  # The files of an item hold nothing that differs from run to run.
    told = {
        "name": item.name,
        "fingerprint": mark,
        "counts": report["counts"],
        "views": [sum(view["accepted"] for view in report["views"]), len(report["views"])],
        "refused": report["refused"],
        "up_confidence": report["up"]["confidence"],
    }
    write_results(result, report, folder, item.suffix, background=item.background)
    (folder / ITEM).write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    return told


def _inputs(item: Item) -> dict[str, Any]:
    """Files and choices, for the report: without folders, which differ from machine to machine."""
    names = {kind: getattr(item, kind) for kind in ("scene", "selection", "cameras")}
    return {
        **{kind: path.replace("\\", "/").rpartition("/")[2] if path else None for kind, path in names.items()},
        "object_id": list(item.selection_options.object_id),
        "name": item.name,
    }


def _is_of_machine(error: BaseException | None) -> bool:
    """Whether the machine is to blame, which another run may find mended: a disk, a permission, memory."""
    while error is not None:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and not isinstance(error, FileNotFoundError)):
            return True
        error = error.__cause__
    return False


class _FinishedByAnotherRun(Exception):  # noqa: N818
    def __init__(self, told: dict[str, Any]) -> None:
        self.told = told


class _TookTooLong(BaseException):
    """Not an `Exception`, which someone on the way might take for another error."""


@contextmanager
def _interruptible(limit: float | None) -> Iterator[None]:
    """Raise `Stopped` when the process is asked to stop, and `_TookTooLong` after so many seconds.

    Compiled kernels turn what a signal raises into other errors, so that any error after it is the interruption.
    """
    expired: list[int] = []
    with stop_signals_raised() as signals, nullcontext() if limit is None else _alarm(limit, expired):
        try:
            yield
        except BaseException as error:
            if signals:
                raise Stopped(signals[0]) from error
            if expired:
                raise _TookTooLong from error
            raise


@contextmanager
def _alarm(seconds: float, expired: list[int]) -> Iterator[None]:
    """Have an error raised after so many seconds, or the process ended if that does not help."""

    def stop(number: int, frame: object) -> None:
        expired.append(number)
        raise _TookTooLong

    seconds += _SECONDS_TO_COMPILE if next(_tried) == 0 else 0.0
    with Path(os.devnull).open("w") as nowhere:
        faulthandler.dump_traceback_later(seconds + _SECONDS_TO_STOP, exit=True, file=nowhere)
        if hasattr(signal, "SIGALRM"):  # which Windows has not
            before = signal.signal(signal.SIGALRM, stop)
            signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            yield
        finally:
            if hasattr(signal, "SIGALRM"):
                signal.setitimer(signal.ITIMER_REAL, 0)
                signal.signal(signal.SIGALRM, before)
            faulthandler.cancel_dump_traceback_later()
