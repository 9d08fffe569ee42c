"""Trims items of one scene after another: a scene is read once for all of its items, and so are their cameras."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.batch.fingerprints import digest_of_cameras, digest_of_file, fingerprint
from gaussian_trimmer.batch.items import Item, options_kind
from gaussian_trimmer.batch.outcomes import Outcome, earlier_outcome, outcome_of
from gaussian_trimmer.batch.storage import ITEM, OutputError, Store, local_copy
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.config import PlanConfig
from gaussian_trimmer.errors import InputError, printable
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.output.report import describe, write_results
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.segmentation.segmenters import get_segmenter
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.trimming.trim import trim

_BUSY = "Another run is writing"
"""How `atomic_folder` begins the error for a folder that is locked."""


class SceneTrimmer:
    """Trims items and writes their results; holds one scene."""

    def __init__(self, store: Store, *, retry_failed: bool = False) -> None:
        self._store, self._retry_failed = store, retry_failed
        self._close = ExitStack()
        self._address, self._path = "", Path()
        self._scene: Gaussians | None = None
        self._cameras: dict[tuple[str, bool], CameraSet] = {}
        self._digests: dict[str, str] = {}

    def check(self, item: Item) -> Outcome | str:
        """What an earlier run made of an item, or its fingerprint if it must be trimmed."""

        def look() -> Outcome | str:
            self._open(item.scene)
            scene = self._digest(item.scene, self._path)
            selection = self._digest(item.selection) if item.selection else None
            cameras = digest_of_cameras(self._camera_set(item)) if item.cameras else None
            found = fingerprint(item, scene, selection, cameras)
            earlier = earlier_outcome(self._store, item, found)
            return found if earlier is None or (earlier.state == "failed" and self._retry_failed) else earlier

        return self._or_failure(item, "", look)

    def trim(self, item: Item, fingerprint: str) -> Outcome:
        """Trim an item that `check` has told the fingerprint of, and write its results, or why it failed."""

        def make() -> Outcome:
            scene, start = self._read(), time.perf_counter()
            inputs = [Path(p) for p in (item.selection, str(self._path), item.cameras) if p and Path(p).is_file()]
            try:
                with self._store.result_folder(item.name, item.suffix, inputs) as folder:
                    told = self._store.finished(item.name)
                    if told is not None and told.get("fingerprint") == fingerprint:
                        raise _FinishedByAnotherRun(told)
                    told = self._write(scene, item, fingerprint, folder)
            except _FinishedByAnotherRun as other:
                return outcome_of(item, other.told)
            self._store.remove_records(item.name)
            return outcome_of(item, told, time.perf_counter() - start, fresh=True)

        found = self._or_failure(item, fingerprint, make)
        assert isinstance(found, Outcome)
        return found

    def close(self) -> None:
        """Let the scene go."""
        self._address, self._scene = "", None
        self._cameras.clear()
        self._digests.clear()
        self._close.close()

    def _open(self, address: str) -> None:
        if address != self._address:
            self.close()
            self._path = formats.find_scene(self._close.enter_context(local_copy(address)))
            self._address = address

    def _read(self) -> Gaussians:
        if self._scene is None:
            self._scene = formats.read(self._path)
        return self._scene

    def _write(self, scene: Gaussians, item: Item, fingerprint: str, folder: Path) -> dict[str, Any]:
        """Trim an item and write its files; returns what `item.json` says."""
        cameras = self._camera_set(item) if item.cameras else None
        result = trim_item(scene, self._selection(scene, item), item, cameras)
        report = describe(result, _inputs(item))
        del report["seconds"]  # The files of an item hold nothing that differs from run to run.
        told = {
            "name": item.name,
            "fingerprint": fingerprint,
            "counts": report["counts"],
            "views": [sum(view["accepted"] for view in report["views"]), len(report["views"])],
            "refused": report["refused"],
            "up_confidence": report["up"]["confidence"],
        }
        with _writing():
            write_results(result, report, folder, item.suffix, background=item.background)
            (folder / ITEM).write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        return told

    def _selection(self, scene: Gaussians, item: Item) -> BoolArray:
        if item.selection is None:
            return np.ones(len(scene), np.bool_)
        with local_copy(item.selection) as path:
            selection = load_selection(path, scene, item.selection_options)
        if selection.all():
            raise InputError(
                f"'{item.selection}' selects all {len(selection)} Gaussians of '{item.scene}'; give the whole scene, "
                "or leave the selection out if the file holds the object alone."
            )
        return selection

    def _camera_set(self, item: Item) -> CameraSet:
        assert item.cameras is not None
        key = item.cameras, item.trust_paths
        if key not in self._cameras:
            with local_copy(item.cameras) as path:
                self._cameras[key] = read_cameras_of(Path(item.scene), path, trust_paths=item.trust_paths)
        return self._cameras[key]

    def _digest(self, address: str, local: Path | None = None) -> str:
        """The digest of a file, which may lie on this machine already."""
        if address not in self._digests:
            with nullcontext(local) if local else local_copy(address) as path:
                self._digests[address] = digest_of_file(path)
        return self._digests[address]

    def _or_failure(self, item: Item, fingerprint: str, work: Callable[[], Outcome | str]) -> Outcome | str:
        """What a function returns; its errors become the outcome of the item and are recorded."""
        details = ""
        try:
            return work()
        except MemoryError as caught:
            error: Exception = caught
            message = "There is not enough memory for this."
        except (InputError, OSError) as caught:
            error, message = caught, _sentence(caught)
        except Exception as caught:  # A defect of the program must not stop the other items.
            error, details = caught, traceback.format_exc()
            message = printable(f"A defect of the program: {type(error).__name__}: {error}", 1000)
        if isinstance(error, OutputError):
            return Outcome(item, "failed", message, cause="busy" if message.startswith(_BUSY) else "output")
        # The next run tries again what the machine is to blame for.
        self._store.record_failure(item.name, message, "" if _is_environment_error(error) else fingerprint, details)
        return Outcome(item, "failed", message, fingerprint=fingerprint)


def trim_item(scene: Gaussians, selection: BoolArray, item: Item, cameras: CameraSet | None) -> TrimResult:
    """Trim one object of a scene that has been read, as `gaussian-trimmer trim` does.

    Raises:
        InputError: the item cannot be trimmed.
    """
    kind = options_kind(item.segmenter)
    options = kind() if item.segmenter_options is None and kind else item.segmenter_options
    segmenter = get_segmenter(item.segmenter, *([] if options is None else [options]))
    views = segmenter.own_cameras(cameras) if hasattr(segmenter, "own_cameras") else None
    if views is not None and item.config.plan.views != PlanConfig().views:
        raise InputError(
            f"The segmenter '{item.segmenter}' looks from the cameras of its {len(views)} masks, so "
            f"{item.config.plan.views} virtual views cannot be had; leave --views and --plan.views out."
        )
    renderer = get_renderer(item.renderer)
    return trim(
        scene,
        selection,
        config=item.config,
        renderer=renderer,
        segmenter=segmenter,
        cameras=cameras,
        view_cameras=views,
    )


class _FinishedByAnotherRun(Exception):  # noqa: N818
    def __init__(self, told: dict[str, Any]) -> None:
        self.told = told


@contextmanager
def _writing() -> Iterator[None]:
    """Tell an output that cannot be written from results that cannot."""
    try:
        yield
    except (InputError, OSError) as error:
        if _is_environment_error(error):
            raise OutputError(_sentence(error)) from error
        raise


def _is_environment_error(error: BaseException | None) -> bool:
    """Whether the machine is to blame, which another run may find mended: a disk, a permission, memory."""
    while error is not None:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and not isinstance(error, FileNotFoundError)):
            return True
        error = error.__cause__
    return False


def _sentence(error: InputError | OSError) -> str:
    if isinstance(error, InputError):
        return str(error)
    place = f": '{error.filename}'" if error.filename else ""
    return f"{error.strerror or error}{place}."


def _inputs(item: Item) -> dict[str, Any]:
    """Files and choices, for the report: without folders, which differ from machine to machine."""
    names = {kind: getattr(item, kind) for kind in ("scene", "selection", "cameras")}
    return {
        **{kind: path.replace("\\", "/").rpartition("/")[2] if path else None for kind, path in names.items()},
        "object_id": list(item.selection_options.object_id),
        "name": item.name,
    }
