"""What a worker does for the driver of a batch: one scene at a time, check its items, read it, trim them one by one.

Requests and replies are plain JSON, so that a process, a node of a cluster and a test are served alike:

    {"do": "check", "scene": ..., "items": [...], "retry_failed": ...}  ->  {"fingerprints", "finished", "failed", ...}
    {"do": "read"}                                                      ->  {"gaussians": ...}
    {"do": "trim", "name": ...}                                         ->  {"finished": ..., "seconds": ...}

A reply with "error" says in one sentence what the user can mend, and whether it was the surroundings, such as a full
disk, that failed and not the item.
"""

from __future__ import annotations

import json
import time
import traceback
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.batch.fingerprints import digest_of_cameras, digest_of_file, fingerprint
from gaussian_trimmer.batch.items import Item, item_of_json, options_kind
from gaussian_trimmer.batch.storage import ITEM, Store, local_copy
from gaussian_trimmer.camera_files import read_cameras_of
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.errors import InputError, printable
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.output.report import describe, write_results
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.result import TrimResult
from gaussian_trimmer.segmentation.segmenters import Segmenter, get_segmenter
from gaussian_trimmer.selection_files import load_selection
from gaussian_trimmer.trimming.trim import trim

Json = dict[str, Any]
_BUSY, _CANNOT_WRITE = "Another run is writing", "Cannot write"
"""How the sentences of `atomic` begin that concern the output and not the item."""


class SceneWorker:
    """Serves requests; holds one scene."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._close = ExitStack()
        self._address = ""
        self._path = Path()
        self._state: tuple[int, ...] = ()
        self._scene: Gaussians | None = None
        self._cameras: dict[tuple[str, bool, Path], CameraSet] = {}
        self._digests: dict[str, str] = {}
        self._items: dict[str, tuple[Item, str]] = {}
        """The items of the scene by name, with their fingerprints."""

    def serve(self, request: Json) -> Json:
        """The reply to a request."""
        start = time.perf_counter()
        try:
            match request["do"]:
                case "check":
                    reply = self._check(request)
                case "read":
                    reply = self._read()
                case "release":
                    self.close()
                    self._address, reply = "", {}
                case _:
                    reply = self._trim(*self._items[request["name"]])
        except MemoryError as error:
            reply = _failure("There is not enough memory for this.", error)
        except InputError as error:
            sentence = str(error)
            busy, write = sentence.startswith(_BUSY), sentence.startswith(_CANNOT_WRITE)
            reply = {**_failure(sentence, error), "busy": busy, "write": write}
        except OSError as error:
            place = f": '{error.filename}'" if error.filename else ""
            reply = _failure(f"{error.strerror or error}{place}.", error)
        except Exception as error:  # A defect of the program must not stop the other items.
            sentence = printable(f"A defect of the program: {type(error).__name__}: {error}", 1000)
            reply = {**_failure(sentence, error), "traceback": traceback.format_exc()}
        return {**reply, "wall": time.perf_counter() - start}

    def close(self) -> None:
        """Let the scene go."""
        self._scene = None
        self._cameras.clear()
        self._digests.clear()
        self._items.clear()
        self._close.close()

    def _check(self, request: Json) -> Json:
        """Fingerprints of the items of a scene, and which of them are finished or have failed already."""
        if request["scene"] != self._address:
            self.close()
            self._address = ""
            self._path = self._close.enter_context(local_copy(request["scene"]))
            self._address = request["scene"]
        self._digests.clear()
        if not self._path.is_file():
            raise InputError(f"There is no file '{request['scene']}'.")
        state = _state(self._path)
        if state != self._state:
            self._scene = None
        self._state = state
        scene = digest_of_file(self._path)
        reply: Json = {"fingerprints": {}, "finished": {}, "failed": {}, "broken": {}}
        for data in request["items"]:
            item = item_of_json(data)
            try:
                self._check_item(item, scene, reply, request["retry_failed"])
            except InputError as error:
                reply["broken"][item.name] = _failure(str(error), error)
        return reply

    def _check_item(self, item: Item, scene: str, reply: Json, retry_failed: bool) -> None:
        selection = self._digest(item.selection) if item.selection else None
        cameras = digest_of_cameras(self._camera_set(item)) if item.cameras else None
        mark = reply["fingerprints"][item.name] = fingerprint(item, scene, selection, cameras)
        self._items[item.name] = item, mark
        finished = self._store.finished(item.name)
        if finished is not None and finished.get("fingerprint") == mark:
            reply["finished"][item.name] = finished
            return
        record = self._store.read(f"records/{item.name}.json")
        if record and record.get("state") == "failed" and record.get("fingerprint") == mark and not retry_failed:
            reply["failed"][item.name] = record

    def _read(self) -> Json:
        if self._scene is None:
            self._scene = formats.read(self._path)
            self._refuse_change()
        return {"gaussians": len(self._scene)}

    def _refuse_change(self) -> None:
        if _state(self._path) != self._state:
            raise InputError(f"'{self._address}' changed while it was read; try again when it is complete.")

    def _trim(self, item: Item, mark: str) -> Json:
        assert self._scene is not None, "a scene is read before its items are trimmed"
        inputs = [Path(p) for p in (item.selection, item.scene, item.cameras) if p and Path(p).is_file()]
        try:
            with self._store.result_folder(item.name, item.suffix, inputs) as folder:
                finished = self._store.finished(item.name)
                if finished is not None and finished.get("fingerprint") == mark:
                    raise _Finished(finished)
                return self._write(item, mark, folder)
        except _Finished as other:
            return {"finished": other.item}

    def _write(self, item: Item, mark: str, folder: Path) -> Json:
        """Trim an object and write its files; returns what is told of it."""
        assert self._scene is not None
        selection = self._selection(item)
        cameras = self._camera_set(item) if item.cameras else None
        result = trim_object(self._scene, selection, item, cameras)
        report = describe(result, _inputs(item))
        del report["seconds"]  # The files of an item hold nothing that differs from run to run.
        write_results(result, report, folder, item.suffix, background=item.background)
        told = {
            "fingerprint": mark,
            "counts": report["counts"],
            "views": [sum(view["accepted"] for view in report["views"]), len(report["views"])],
            "refused": report["refused"],
            "up_confidence": report["up"]["confidence"],
        }
        (folder / ITEM).write_text(json.dumps({"name": item.name, **told}, indent=1) + "\n", encoding="utf-8")
        return {"finished": told, "seconds": {stage: round(s, 4) for stage, s in result.seconds.items()}}

    def _selection(self, item: Item) -> BoolArray:
        assert self._scene is not None
        if item.selection is None:
            return np.ones(len(self._scene), np.bool_)
        with local_copy(item.selection) as path:
            selection = load_selection(path, self._scene, item.selection_options)
        if selection.all():
            raise InputError(
                f"'{item.selection}' selects all {len(selection)} Gaussians of '{item.scene}'; give the whole scene, "
                "or leave the selection out if the file holds the object alone."
            )
        return selection

    def _digest(self, address: str) -> str:
        if address not in self._digests:
            with local_copy(address) as path:
                self._digests[address] = digest_of_file(path)
        return self._digests[address]

    def _camera_set(self, item: Item) -> CameraSet:
        assert item.cameras is not None
        scene = Path(item.scene)
        key = item.cameras, item.trust_paths, scene.parent
        if key not in self._cameras:
            with local_copy(item.cameras) as path:
                self._cameras[key] = read_cameras_of(scene, path, trust_paths=item.trust_paths)
        return self._cameras[key]


def trim_object(scene: Gaussians, selection: BoolArray, item: Item, cameras: CameraSet | None) -> TrimResult:
    """Trim one object of a scene that has been read, as `gaussian-trimmer trim` does.

    Raises:
        InputError: the item cannot be trimmed.
    """
    segmenter = _segmenter(item)
    views = segmenter.own_cameras(cameras) if hasattr(segmenter, "own_cameras") else None
    return trim(
        scene, selection, config=item.config, renderer=get_renderer(item.renderer), segmenter=segmenter,
        cameras=cameras, view_cameras=views,
    )  # fmt: skip


class _Finished(Exception):  # noqa: N818
    """Another run has finished the item meanwhile."""

    def __init__(self, item: Json) -> None:
        self.item = item


def _segmenter(item: Item) -> Segmenter:
    options = item.segmenter_options
    if options is None and (kind := options_kind(item.segmenter)):
        options = kind()
    return get_segmenter(item.segmenter, options) if options is not None else get_segmenter(item.segmenter)


def _inputs(item: Item) -> Json:
    """Files and choices, for the report: without folders, which differ from machine to machine."""
    names = {kind: getattr(item, kind) for kind in ("scene", "selection", "cameras")}
    return {
        **{kind: path.replace("\\", "/").rpartition("/")[2] if path else None for kind, path in names.items()},
        "object_id": list(item.selection_options.object_id),
        "name": item.name,
    }


def _failure(sentence: str, error: BaseException) -> Json:
    return {"error": sentence, "surroundings": _is_of_the_surroundings(error)}


def _is_of_the_surroundings(error: BaseException | None) -> bool:
    """Whether something failed that another run may find mended: a disk, a permission, memory."""
    while error is not None:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and not isinstance(error, FileNotFoundError)):
            return True
        error = error.__cause__
    return False


def _state(path: Path) -> tuple[int, ...]:
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(f"Cannot read '{path}': {error.strerror or error}.") from error
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_dev
