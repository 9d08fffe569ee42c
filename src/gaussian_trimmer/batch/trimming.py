"""Trims items and writes the results of each, or why it failed: the work of a batch, wherever it runs."""

from __future__ import annotations

import faulthandler
import os
import time
import traceback
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.batch.fingerprints import digest_of_contents, fingerprint
from gaussian_trimmer.batch.items import Item
from gaussian_trimmer.batch.store import Outcome, Store, write_finished
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import FolderInUseError, InputError, printable, user_message
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.masks import get_segmenter
from gaussian_trimmer.output.report import describe
from gaussian_trimmer.output.saving import write_trim
from gaussian_trimmer.selecting.reading import read_selection_result
from gaussian_trimmer.settings import to_plain
from gaussian_trimmer.trimming.arguments import refuse_whole_scene
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.trimming.trim_options import views_of_masks

SECONDS_TO_COMPILE = 300.0
"""What the first item of a process is granted beyond the time limit."""
_SECONDS_BETWEEN_LOOKS = 0.5


class ItemTrimmer:
    """Trims items one after the other; those of one scene read it once.

    Args:
        output: folder of the results.
        retry_failed: try those items again that failed in an earlier run.
        time_limit: seconds that one item may take; then the process ends, whatever it is doing.
        threads: how many a trim uses; None leaves that as it is.
    """

    def __init__(
        self, output: Path, retry_failed: bool = False, time_limit: float | None = None, threads: int | None = None
    ) -> None:
        self._store, self._retry_failed, self._time_limit = Store(output), retry_failed, time_limit
        self._scene: Scene | None = None
        self._granted = SECONDS_TO_COMPILE
        self._nowhere = Path(os.devnull).open("w") if time_limit is not None else None  # noqa: SIM115
        if threads is not None:
            import cv2
            import numba

            cv2.setNumThreads(threads)
            numba.set_num_threads(threads)

    def trim(self, item: Item) -> Outcome | None:
        """Return what becomes of an item, whatever goes wrong; None if another run is writing it.

        What an earlier run has finished is not done again.
        """
        if self._scene is None or not self._scene.is_of(item):
            self._scene = Scene(item)
        if self._time_limit is None or self._nowhere is None:
            return self._outcome(item, self._scene)
        faulthandler.dump_traceback_later(self._time_limit + self._granted, exit=True, file=self._nowhere)
        try:
            return self._outcome(item, self._scene)
        finally:
            faulthandler.cancel_dump_traceback_later()
            self._granted = 0.0

    def _outcome(self, item: Item, scene: Scene) -> Outcome | None:
        mark, details, writing, store = "", "", False, self._store
        try:
            mark = scene.fingerprint(item)
            earlier = store.earlier(item, mark)
            if earlier is not None and not (earlier.state == "failed" and self._retry_failed):
                store.clean(item.name)
                return earlier
            gaussians, start, writing = scene.gaussians, time.perf_counter(), True
            with store.result_folder(item, scene.input_files(item)) as folder:
                writing = False
                if (told := store.earlier(item, mark)) is not None and told.state == "done":
                    raise _FinishedByAnotherRun(told)
                result = trim_item(gaussians, item, scene.cameras(item))
                writing = True
                done = _write(result, item, mark, folder)
            outcome = replace(done, seconds=time.perf_counter() - start)
        except _FinishedByAnotherRun as other:
            return other.outcome
        except FolderInUseError:
            time.sleep(_SECONDS_BETWEEN_LOOKS)
            return None
        except (InputError, OSError, MemoryError) as error:
            of_machine = _is_of_machine(error)  # which the next run may find mended
            outcome = Outcome(item, "failed", user_message(error) or "", fingerprint="" if of_machine else mark)
            if of_machine and writing:
                return Outcome(item, "failed", outcome.message, unwritten=True)
        except Exception as error:  # A defect of the program must not stop the other items.
            details = traceback.format_exc()
            message = printable(f"A defect of the program: {type(error).__name__}: {error}", 1000)
            outcome = Outcome(item, "failed", message, fingerprint=mark)
        store.record(outcome, details)
        return outcome


class Scene:
    """The scene of an item, with what else its items have in common, each read when it is first needed."""

    def __init__(self, item: Item) -> None:
        self._given, self._level = Path(item.scene), item.level
        self._cameras = cache(lambda path, trust: read_cameras_of(self._given, Path(path), trust_paths=trust))
        self._digest_of = cache(digest_of_contents)

    def is_of(self, item: Item) -> bool:
        """Return whether an item is of this scene."""
        return (Path(item.scene), item.level) == (self._given, self._level)

    @cached_property
    def path(self) -> Path:
        """The splat file."""
        return identify(self._given).scene

    @cached_property
    def gaussians(self) -> Gaussians:
        """The Gaussians of the scene."""
        return formats.read(self.path, level=self._level)

    def cameras(self, item: Item) -> CameraSet | None:
        """Return the cameras of an item, if it has some."""
        return None if item.cameras is None else self._cameras(item.cameras, item.trust_paths)

    def fingerprint(self, item: Item) -> str:
        """Return the digest of an item and its inputs."""
        files = formats.scene_files(self.path, self._level)
        return fingerprint(item, files, self.cameras(item), self._digest_of)

    def input_files(self, item: Item) -> list[Path]:
        """Return the files that an item is made from."""
        return [Path(p) for p in (item.selection, str(self.path), item.cameras) if p and Path(p).is_file()]


def trim_item(scene: Gaussians, item: Item, cameras: CameraSet | None) -> TrimResult:
    """Trim an item of a scene as `gaussian-trimmer trim` does.

    Raises:
        InputError: the item cannot be trimmed.
    """
    selection = read_selection_result(
        item.selection,
        scene,
        item.selection_options,
        cameras=cameras,
        camera_path=None if item.cameras is None else Path(item.cameras),
        up=item.config.up,
    )
    if item.selection is not None:
        refuse_whole_scene(selection.mask, item.selection, item.scene)
    options = [] if item.segmenter_options is None else [item.segmenter_options]
    segmenter = get_segmenter(item.segmenter, *options)
    return trim(
        scene,
        selection,
        config=item.config,
        segmenter=segmenter,
        cameras=cameras,
        view_cameras=views_of_masks(segmenter, cameras, item.config),
    )


def _write(result: TrimResult, item: Item, mark: str, folder: Path) -> Outcome:
    """Write the files of an item, and return its outcome."""
    report = describe(result, _inputs(item))
    del report["seconds"]  # The files of an item hold nothing that differs from run to run.
    outcome = Outcome(
        item,
        "done",
        counts=report["counts"],
        views=(sum(view["accepted"] for view in report["views"]), len(report["views"])),
        refused=report["refused"] or "",
        warnings=tuple(report["warnings"]),
        shrunk_side=report["shrunk_side"] or "",
        up_confidence=report["up"]["confidence"],
        fingerprint=mark,
    )
    write_trim(result, report, folder, item.suffix, background=item.background, html=item.html)
    if item.placing.wished:
        item.placing.write(result, folder, item.suffix, background=item.background)
    write_finished(outcome, folder)
    return outcome


def _inputs(item: Item) -> dict[str, Any]:
    """Return files and choices, for the report: without folders, which differ from machine to machine."""
    names = {kind: getattr(item, kind) for kind in ("scene", "selection", "cameras")}
    return {
        **{kind: path.replace("\\", "/").rpartition("/")[2] if path else None for kind, path in names.items()},
        "object_id": list(item.selection_options.object_id),
        "name": item.name,
        "placing": to_plain(item.placing),
    }


def _is_of_machine(error: BaseException | None) -> bool:
    """Return whether the machine is to blame, which another run may find mended: a disk, a permission, memory."""
    while error is not None:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and not isinstance(error, FileNotFoundError)):
            return True
        error = error.__cause__
    return False


class _FinishedByAnotherRun(Exception):  # noqa: N818
    def __init__(self, outcome: Outcome) -> None:
        self.outcome = outcome
