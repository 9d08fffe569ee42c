"""Projects: the objects that are marked in a scene, as JSON to come back to; and where the app keeps its own files."""

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
from gaussian_trimmer.app.documents import Progress
from gaussian_trimmer.app.edits import Change
from gaussian_trimmer.app.snapshots import Colour, Cut, CutState, MarkedObject, Snapshot, TrimChoices
from gaussian_trimmer.cameras import Point
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import PROJECT, identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.io.writing import make_folder, write_whole
from gaussian_trimmer.selecting.marks import Marks, marks_as_json, marks_from_json
from gaussian_trimmer.settings import from_plain, to_plain

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
    """Return where the app keeps its own files on this machine."""
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
    """Write a file that its user alone can read; missing folders are made, and private.

    Raises:
        InputError: it cannot be written.
    """
    private_folder(path.parent)
    write_whole(path, data)
    with suppress(OSError):
        path.chmod(0o600)


def autosave_path(folder: Path, scene: Gaussians) -> Path:
    """Return where work on a scene is kept: by what the scene holds, wherever its file lies."""
    rows = np.linspace(0, len(scene) - 1, min(len(scene), _HASHED_GAUSSIANS)).astype(np.int64)
    data = np.concatenate([scene.means[rows], scene.sh_dc[rows]], axis=1)
    return folder / f"{hashlib.sha256(data.tobytes()).hexdigest()[:16]}-{len(scene)}.json"


def project_as_json(now: Snapshot, folder: Path) -> str:
    """Return a state as a project's file in a folder has it."""
    document = now.document
    project = Project(
        document.path.absolute(),
        None if document.camera_path is None else document.camera_path.absolute(),
        len(document.scene),
        now.given_up,
        now.active,
        tuple(
            _SavedObject(
                part.name,
                part.colour,
                part.hidden,
                part.locked,
                part.cut.choices,
                replace(now.basis, marks=part.marks),
                part.cut.state in (CutState.FRESH, CutState.WANTED),
            )
            for part in now.objects
        ),
    )
    writers: dict[Any, Any] = {Path: str, Marks: lambda marks: marks_as_json(marks, folder)}
    plain = {"content": PROJECT, "version": __version__, **to_plain(project, writers)}
    return json.dumps(plain, indent=1, allow_nan=False)


def is_project(path: Path) -> bool:
    """Tell whether a file is a project, as far as its beginning tells."""
    return identify(path).kind == "project"


def read_project(path: Path) -> Project:
    """Return the project in a file.

    Raises:
        InputError: it cannot be read, or is not a project.
    """
    raw = read_json(path)
    if not isinstance(raw, dict) or raw.pop("content", None) != PROJECT:
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


def restore(now: Snapshot, project: Project, progress: Progress = lambda stage: None) -> Change:
    """Go on with a project in its scene, its marks understood anew; it says what is to be cut out again.

    Args:
        now: a state of the scene.
        project: what was saved.
        progress: called with what is understood.

    Raises:
        InputError: the scene is another one, or a mark is not possible.
    """
    document, n = now.document, len(now.document.scene)
    if project.scene_size != n:
        raise InputError(
            f"This project is of '{project.scene.name}', which has {project.scene_size:,} Gaussians, and this scene "
            f"has {n:,}; open its own scene first."
        )
    up, places = document.find_up(project.up), project.objects[0].marks.photographed_from
    basis = document.basis(up)
    now = replace(now, up=up, basis=replace(basis, photographed_from=places or basis.photographed_from))
    parts = []
    for number, saved in enumerate(project.objects, 1):
        progress(f"the marks of {saved.name}")
        parts.append(
            MarkedObject(
                number,
                saved.name,
                saved.colour,
                now.applied(now.nothing(), saved.marks.marks),
                saved.marks.marks,
                Cut(CutState.WANTED if saved.cut_out else CutState.NONE, None, saved.choices),
                hidden=saved.hidden,
                locked=saved.locked,
            )
        )
    after = replace(now, objects=tuple(parts), active=project.active, next_id=len(parts) + 1, last="work of last time")
    marked = sum(bool(part.marks) for part in parts)
    again = any(part.cut.state is CutState.WANTED for part in parts) * " What was cut out is being cut out again."
    said = f"Your work is back: {marked} object{'s' * (marked > 1)} marked.{again} Undo takes it away."
    return Change(after, f"{said} {after.sentence}")
