"""What comes into the app as files and what leaves it: scenes, cameras, selections, projects and results."""

from __future__ import annotations

import secrets
import shlex
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.app.edits import add_scene, trim_object
from gaussian_trimmer.app.session import Session, autosave_path, project_as_json, read_project, restore
from gaussian_trimmer.app.snapshots import Document, MarkedObject, Progress, Snapshot
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.io.writing import private_folder, safe_file_name, write_private
from gaussian_trimmer.output.engines import ENGINES, EngineName, PlacingOptions
from gaussian_trimmer.output.report import describe, file_stems
from gaussian_trimmer.output.saving import RESULTS, result_files, write_trim
from gaussian_trimmer.selecting.marks import FromFile, FromMasks, write_marks
from gaussian_trimmer.settings import to_plain
from gaussian_trimmer.trimming.result import THE_OBJECT, TrimResult
from gaussian_trimmer.trimming.trim import trim_objects

MARKS = "selection.json"
"""Name of the file of marks among the results, the same as the command line's."""
OBJECT, WITHOUT, ALL_FILES = DOWNLOADS = ("Object", "Scene without it", "All files")
_MOST_RECENT = 5
_KEPT_SECONDS = 7 * 24 * 3600.0
CAMERA_NAMES = ("cameras.json", "transforms.json", "transforms_train.json")


class Files:
    """Opens, saves and sends files for a session. Its methods return a sentence."""

    def __init__(self, session: Session, state: Path) -> None:
        """Work for a session; what the app itself keeps goes to the folder `state`."""
        self._session, self._state = session, state
        self._kept: Snapshot | None = None

    def open(self, path: Path, camera_path: Path | None, progress: Progress = lambda stage: None) -> str:
        """Open a scene with its cameras, and go on with the work that was kept of it; or open a project.

        A project is opened in the open scene if that is the project's, else in the scene that it names.
        """
        session, project = self._session, None
        if identify(path).kind == "project":
            project, now = read_project(path), session.glance()
            if now is not None and len(now.document.scene) == project.scene_size:
                return session.do(restore, project, progress)
            path, camera_path = project.scene, project.cameras
        session.open(path, camera_path, progress)
        self._kept = session.now
        if project is not None:
            return session.do(restore, project, progress)
        if not self._autosave.is_file():
            return session.now.sentence
        try:
            return session.do(restore, read_project(self._autosave), progress)
        except InputError as error:  # or cancelled
            return f"{session.now.sentence} The work of last time is not back: {error}"

    def recent(self) -> list[tuple[str, str, str]]:
        """Return names, paths and cameras of the scenes with work that was kept last, the newest first."""
        kept = sorted((self._state / "projects").glob("*.json"), key=lambda path: path.stat().st_mtime, reverse=True)
        scenes = []
        for path in kept[:_MOST_RECENT]:
            with suppress(InputError):
                project = read_project(path)
                scenes.append((project.scene.name, str(project.scene), str(project.cameras or "")))
        return scenes

    def store(self, name: str, content: Path, digest: str) -> Path:
        """Keep a file that came from the browser under its name, and return its path.

        Files of last week are removed, but those of the scene that is open.
        """
        folder, now = self._state / "files", self._session.glance()
        used = {now.document.path, now.document.camera_path} if now else set()
        for old in folder.glob("*/*"):
            with suppress(OSError):
                if old not in used and time.time() - old.stat().st_mtime > _KEPT_SECONDS:
                    old.unlink()
                    old.parent.rmdir()
        path = private_folder(folder / digest[:16]) / (Path(name).name or "file")
        content.replace(path)
        return path

    def add(self, path: Path, progress: Progress) -> str:
        """Put the scene in a file beside the open one, as an object; both are one file from then on, which is kept."""
        progress("reading the scene")
        added = Document.read(path, None).scene
        folder = private_folder(self._state / "scenes" / secrets.token_hex(8))
        name = safe_file_name(path.name.split(".")[0])
        progress("putting it beside the other")
        both = folder / f"{self._session.document.path.name.split('.')[0]}_and_{name}.ply"
        return self._session.do(add_scene, added, name, both)

    def keep(self) -> None:
        """Keep the work on the scene, if it has changed; the next time that the scene is opened, it is back.

        Raises:
            InputError: it cannot be written.
        """
        now = self._session.glance()
        if now is None or now is self._kept:
            return
        self._kept = now
        if now.has_work:
            write_private(self._autosave, project_as_json(now, self._autosave.parent))
        else:
            self._autosave.unlink(missing_ok=True)

    def download(self, what: str, format: str | None, client: Any, engine: EngineName | None = None) -> str:
        """Send one of `DOWNLOADS` to the browser; for an engine, with the object upright and its foot at the origin."""
        now = self._session.now
        result, name = fresh_result(now), safe_file_name(now.object.name)
        if what == WITHOUT and result.nothing_trimmed:
            raise InputError(f"'{now.object.name}' was not cut out, so there is no scene without it; mark it anew.")
        with TemporaryDirectory() as parent:
            folder = Path(parent, name)
            if what == ALL_FILES:
                save(now, folder, format, engine=engine)
                path = Path(shutil.make_archive(str(folder), "zip", parent, name))
            else:
                suffix = now.document.suffix(format or (engine and ENGINES[engine].reads[0]))
                path = Path(parent, f"{'' if what == OBJECT else 'without_'}{name}{suffix}")
                thing = moved(result, [now.object]).object
                gaussians = thing if what == OBJECT else result.background
                if engine:
                    place = PlacingOptions(engine).placement(thing, result.objects[0].up.direction)
                    gaussians = place.apply(gaussians)
                formats.write(gaussians, path)
            data = path.read_bytes()
        client.send_file(path.name, data)
        return f"{path.name} ({len(data) / 1e6:.1f} MB) is among the browser's downloads."

    def download_project(self, client: Any) -> str:
        """Send the project to the browser."""
        now = self._session.now
        name = f"{now.document.path.name.split('.')[0]}.project.json"
        client.send_file(name, project_as_json(now, Path.cwd()).encode())
        return f"{name} is among the browser's downloads; drop it on the page to go on with it."

    @property
    def _autosave(self) -> Path:
        return autosave_path(self._state / "projects", self._session.document.scene)


def save(
    now: Snapshot,
    folder: Path,
    format: str | None = None,
    progress: Progress = lambda stage: None,
    *,
    engine: EngineName | None = None,
    together: bool = False,
    overwrite: bool = False,
    kept: Callable[[TrimResult], object] = lambda result: None,
) -> tuple[str, str]:
    """Save results with the marks from which they can be made again; return what was saved, and a command for it.

    Args:
        now: the state to save.
        folder: new or empty, or with earlier results.
        format: ending of the splat files; the scene's own, or the nearest that can be written, if it is not given.
        progress: called with the name of each stage when it begins.
        engine: write files for this program beside the others.
        together: trim all marked objects, so that no Gaussian is in two, and save them by name; there is no command
            then. Otherwise the cut-out of the active object is saved.
        overwrite: replace earlier results in the folder.
        kept: called with what all objects were trimmed to together, once it is saved.

    Raises:
        InputError: no object is marked or cut out, or the files cannot be written.
    """
    document, suffix = now.document, now.document.suffix(format)
    parts = [part for part in now.objects if part.n_selected] if together else [now.object]
    if not parts:
        raise InputError("No object is marked; mark one first.")
    cut_out, said = None if together else fresh_result(now), ""
    if now.object.together and not together:  # the command makes it alone
        cut_out = trim_object(now, now.object.choices, progress).after.object.fresh
    placing = PlacingOptions(engine, "scene" if not engine and any(part.moved for part in parts) else None)
    names = (*result_files(suffix), "views/*.png", "selection*.json", *placing.patterns(suffix))
    inputs = _inputs(document, parts)
    with atomic_folder(folder, RESULTS, names=names, inputs=inputs, overwrite=overwrite) as results:
        result = cut_out or trim_objects(
            document.scene,
            {part.name: now.selection_of(part) for part in parts},
            config=now.object.choices.config(now.given_up),
            up=now.up if now.given_up else None,
            cameras=document.cameras,
            progress=progress,
        )
        cameras = str(document.camera_path.absolute()) if document.camera_path else None
        given: dict[str, Any] = {"scene": str(document.path.absolute()), "cameras": cameras, "format": format}
        given |= {} if together else {"name": now.object.name, "marks": MARKS}
        given["placing"] = to_plain(PlacingOptions(engine))  # what was moved by hand is the app's alone
        report = describe(result, given, suffix=suffix)
        progress("write")
        if not together:
            report["command"] = _command(now, folder, format, engine)
        write_trim(result, report, results, suffix)
        if placing.wished:
            said = f" {placing.sentence(placing.write(moved(result, parts), results, suffix), result.objects[0].up)}"
        stems = file_stems((part.id, part.name) for part in result.objects).values()
        for part, stem in zip(parts, stems, strict=True):
            file = f"{stem.replace(THE_OBJECT, 'selection', 1)}.json"
            write_marks(replace(now.basis, marks=part.marks), results / file)
    if together:
        kept(result)
        hidden = sum(part.hidden for part in parts)
        said += f" {hidden} of them {'is' if hidden == 1 else 'are'} hidden." if hidden else ""
        return f"{len(parts)} objects saved in '{folder}'.{said}", ""
    return f"Saved in '{folder}'.{said}", command_for(folder)


def moved(result: TrimResult, parts: Sequence[MarkedObject]) -> TrimResult:
    """Return a trim of some objects with each where it was moved to."""
    objects = (
        replace(trimmed, gaussians=part.moved.apply(trimmed.gaussians)) if part.moved else trimmed
        for trimmed, part in zip(result.objects, parts, strict=True)
    )
    return replace(result, objects=tuple(objects))


def _command(now: Snapshot, folder: Path, format: str | None, engine: EngineName | None) -> list[str]:
    """Return the words of the command that makes the active object's cut-out, with its marks in a folder."""
    document, choices = now.document, now.object.choices
    config = choices.config(now.given_up)
    words = ["trim", str(document.path.absolute()), str((folder / MARKS).absolute())]
    words += ["--cameras", str(document.camera_path.absolute())] if document.camera_path else []
    words += ["--up", *map(repr, config.up)] if config.up else []
    words += ["--refine", config.refine, "--background", config.background]
    words += ["--with-what-stands-on-it"] if choices.with_standing else []
    words += [] if choices.recover else ["--set", "evidence.recover=false"]
    words += ["--format", format] if format else []
    return [*words, "--for", engine] if engine else words


def command_for(folder: Path) -> str:
    """Return the command that makes again what was saved in a folder, from wherever it is run."""
    report = (folder / "report.json").absolute()
    return shlex.join(["gaussian-trimmer", "trim", "--config", str(report), "--output", "again"])


def fresh_result(now: Snapshot) -> TrimResult:
    """Return the cut-out of the active object as it is marked.

    Raises:
        InputError: it has not been cut out since it was marked.
    """
    if now.object.fresh is None:
        raise InputError(f"'{now.object.name}' has not been cut out since it was marked; press 'Cut out' first.")
    return now.object.fresh


def path_of(text: str, what: str) -> Path:
    """Return the path that a field names, as browsers and file managers copy it, too.

    Raises:
        InputError: there is none; `what` says of what it should be.
    """
    if not (text := text.strip().strip("\"'")):
        raise InputError(f"Give the path of {what} first.")
    return Path(text.removeprefix("file://")).expanduser()


def _inputs(document: Document, objects: Sequence[MarkedObject]) -> list[Path]:
    """Return files that must not be replaced."""
    given = [document.path, document.camera_path]
    for mark in (mark for part in objects for mark in part.marks):
        given += [mark.path] if isinstance(mark, FromFile) else [mark.folder] if isinstance(mark, FromMasks) else []
    return [path for path in given if path is not None and (path.is_file() or path is not document.camera_path)]
