"""Projects: the objects that are marked in a scene, as JSON to come back to; and where the app keeps its own files."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gaussian_trimmer._version import __version__
from gaussian_trimmer.app.edits import Change, check_name, understood_with
from gaussian_trimmer.app.snapshots import MarkedObject, Progress, Snapshot
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import PROJECT, identify
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.reading import read_json
from gaussian_trimmer.io.writing import make_folder, write_whole
from gaussian_trimmer.selecting.marks import Marks, marks_as_json, marks_from_json
from gaussian_trimmer.settings import from_plain

_HASHED_GAUSSIANS = 1000


@dataclass(frozen=True)
class Project:
    """What a project's file says: a scene, and the names and marks of the objects in it."""

    scene: Path
    cameras: Path | None
    objects: dict[str, Marks]
    """By name; all know the number of the scene's Gaussians."""

    @property
    def scene_size(self) -> int | None:
        """Number of Gaussians of the scene."""
        return next(iter(self.objects.values())).scene_size


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
    plain = {
        "content": PROJECT,
        "version": __version__,
        "scene": str(document.path.absolute()),
        "cameras": None if document.camera_path is None else str(document.camera_path.absolute()),
        "objects": {part.name: marks_as_json(replace(now.basis, marks=part.marks), folder) for part in now.objects},
    }
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
    if not isinstance(raw, dict) or raw.get("content") != PROJECT:
        raise InputError(f"'{path}' is not a project.")
    where, objects = f"'{path}': project.", raw.get("objects")
    if not isinstance(objects, dict) or not objects:
        raise InputError(f"'{path}' is damaged: it has no objects.")
    project = Project(
        from_plain(raw.get("scene"), Path, f"{where}scene"),
        from_plain(raw.get("cameras"), Path | None, f"{where}cameras"),
        {check_name(name): marks_from_json(marks, path) for name, marks in objects.items()},
    )
    if len({marks.scene_size for marks in project.objects.values()}) > 1:
        raise InputError(f"'{path}' is damaged: its objects are of different scenes.")
    return project


def restore(now: Snapshot, project: Project, progress: Progress = lambda stage: None) -> Change:
    """Go on with a project in its scene, its marks understood anew.

    Args:
        now: a state of the scene.
        project: what was saved.
        progress: called with what is understood.

    Raises:
        InputError: the scene is another one, or a mark is not possible.
    """
    n, first = len(now.document.scene), next(iter(project.objects.values()))
    if first.scene_size != n:
        raise InputError(
            f"This project is of '{project.scene.name}', which has {first.scene_size or 0:,} Gaussians, and this "
            f"scene has {n:,}; open its own scene first."
        )
    now = understood_with(now, first)
    parts: list[MarkedObject] = []
    for number, (name, saved) in enumerate(project.objects.items(), 1):
        progress(f"the marks of {name}")
        selected = now.applied(now.nothing(), saved.marks)
        colour = replace(now, objects=tuple(parts)).contrasting_colour(selected.mask)
        parts.append(MarkedObject(number, name, colour, selected, saved.marks))
    last = len(parts) - 1
    after = replace(now, objects=tuple(parts), active=last, next_id=len(parts) + 1, last="work of last time")
    marked = sum(bool(part.marks) for part in parts)
    said = f"Your work is back: {marked} object{'s' * (marked > 1)} marked. Undo takes it away."
    return Change(after, f"{said} {after.sentence}")
