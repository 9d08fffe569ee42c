"""Projects: the objects that are marked in a scene, as JSON to come back to."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.app.documents import Document, Progress, TrimChoices, basis_of, up_of
from gaussian_trimmer.app.snapshots import Colour, MarkedObject, Snapshot
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.io.writing import make_folder, write_whole
from gaussian_trimmer.selecting.interpretation import SelectionState
from gaussian_trimmer.selecting.marks import Marks, Point, point_of
from gaussian_trimmer.selecting.marks_file import marks_as_json, marks_from_json
from gaussian_trimmer.settings import from_plain, to_plain

CONTENT = "gaussian-trimmer project"
_HASHED_GAUSSIANS = 1000


@dataclass(frozen=True)
class _SavedObject:
    """An object as the file has it."""

    name: str
    colour: Colour
    hidden: bool
    locked: bool
    choices: TrimChoices
    marks: Marks
    cut_out: bool = False
    """Whether it was cut out as it is marked; the trim itself is made again, bit by bit the same."""


@dataclass(frozen=True)
class Project:
    """What a project's file says."""

    scene: Path
    cameras: Path | None
    scene_size: int
    up: Point | None
    """As it was given; None: as the cameras or the ground have it."""
    active: int
    """Place of the object that was being marked."""
    objects: tuple[_SavedObject, ...]


def state_folder() -> Path:
    """Where the app keeps its own files on this machine."""
    return Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser() / "gaussian-trimmer"


def private_folder(folder: Path) -> Path:
    """Make a folder that its user alone can enter, and return it.

    Raises:
        InputError: it cannot be made.
    """
    make_folder(folder)
    with suppress(OSError):  # a file system without permissions
        folder.chmod(0o700)
    return folder


def write_private(path: Path, data: str | bytes) -> None:
    """Write a file that its user alone can read, into a private folder.

    Raises:
        InputError: it cannot be written.
    """
    write_whole(path, data)
    with suppress(OSError):
        path.chmod(0o600)


def autosave_path(folder: Path, scene: Gaussians) -> Path:
    """Where work on a scene is kept: by what the scene holds, wherever its file lies."""
    rows = np.linspace(0, len(scene) - 1, min(len(scene), _HASHED_GAUSSIANS)).astype(np.int64)
    data = np.concatenate([scene.means[rows], scene.sh_dc[rows]], axis=1)
    return folder / f"{hashlib.sha256(data.tobytes()).hexdigest()[:16]}-{len(scene)}.json"


def project_as_json(now: Snapshot, folder: Path) -> dict[str, Any]:
    """A state as a project's file in a folder has it."""
    document = now.document
    project = Project(
        document.path.absolute(),
        None if document.camera_path is None else document.camera_path.absolute(),
        len(document.scene),
        point_of(now.up.direction) if now.up.source == "given" else None,
        now.active,
        tuple(
            _SavedObject(
                part.name,
                part.colour,
                part.hidden,
                part.locked,
                part.choices,
                replace(now.basis, marks=part.marks),
                part.result is not None or part.to_cut_out,
            )
            for part in now.objects
        ),
    )
    writers: dict[Any, Any] = {Path: str, Marks: lambda marks: marks_as_json(marks, folder)}
    return {"content": CONTENT, "version": __version__, **to_plain(project, writers)}


def write_project(now: Snapshot, path: Path) -> None:
    """Write a state's project; missing folders are made.

    Raises:
        InputError: the file cannot be written.
    """
    private_folder(path.parent)
    write_private(path, json.dumps(project_as_json(now, path.parent), indent=1, allow_nan=False))


def is_project(path: Path) -> bool:
    """Whether a file is a project, as far as its beginning tells."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        return f'"content": "{CONTENT}"'.encode() in file.read(256)


def read_project(path: Path) -> Project:
    """The project in a file.

    Raises:
        InputError: it cannot be read, or is none.
    """
    raw = read_json(path)
    if not isinstance(raw, dict) or raw.pop("content", None) != CONTENT:
        raise InputError(f"'{path}' is not a project.")
    raw.pop("version", None)
    readers = {Marks: lambda data, place: marks_from_json(data, path)}
    project: Project = from_plain(raw, Project, f"'{path}': project", readers)
    if not project.objects or not 0 <= project.active < len(project.objects):
        raise InputError(f"'{path}' is damaged: its active object is not there.")
    names = [part.name for part in project.objects]
    if len(set(names)) < len(names):
        raise InputError(f"'{path}' has two objects of the same name; give each its own.")
    return project


def restored(project: Project, document: Document, progress: Progress) -> Snapshot:
    """The state that a project stands for, its marks understood anew in a scene; it says what is to be trimmed again.

    Args:
        project: what was saved.
        document: the scene, which must be the project's, and its cameras.
        progress: called with what is understood.

    Raises:
        InputError: the scene is another one, or a mark is not possible.
    """
    n = len(document.scene)
    if project.scene_size != n:
        raise InputError(
            f"This project is of '{project.scene.name}', which has {project.scene_size:,} Gaussians, and this scene "
            f"has {n:,}; open its own scene first."
        )
    up = up_of(document, project.up)
    basis = basis_of(document, up)
    saved = project.objects[0].marks
    basis = replace(basis, photographed_from=saved.photographed_from or basis.photographed_from)
    parts = tuple(
        MarkedObject(
            number,
            saved.name,
            saved.colour,
            SelectionState.nothing(n),
            choices=saved.choices,
            hidden=saved.hidden,
            locked=saved.locked,
            to_cut_out=saved.cut_out,
        )
        for number, saved in enumerate(project.objects, 1)
    )
    now = Snapshot(document, up, basis, parts, project.active, "work of last time")
    objects = []
    for part, saved_object in zip(parts, project.objects, strict=True):
        progress(f"the marks of {part.name}")
        marks = saved_object.marks.marks
        objects.append(replace(part, marks=marks, selected=now.applied(part.selected, marks)))
    return replace(now, objects=tuple(objects))
