"""What comes into the app as files and what leaves it: scenes, cameras, selections, projects and results."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.app import panels as controls
from gaussian_trimmer.app.panels import Panels
from gaussian_trimmer.app.placing import stood_upright
from gaussian_trimmer.app.project import (
    autosave_path,
    is_project,
    private_folder,
    project_as_json,
    read_project,
    restored,
    state_folder,
    write_private,
    write_project,
)
from gaussian_trimmer.app.saving import Target
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import Snapshot
from gaussian_trimmer.app.worker import stopping
from gaussian_trimmer.errors import InputError, OutputExistsError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.io.names import safe_file_name
from gaussian_trimmer.output.html.viewer import export_viewer
from gaussian_trimmer.output.result import TrimResult

__all__ = ["Files", "private_folder", "state_folder", "write_private"]
Stages = Callable[[int, str], Callable[[str], None]]
"""What shows the progress of about so many stages, whose names begin with a text."""

_CAMERA_NAMES = ("cameras.json", "transforms.json", "transforms_train.json")


class Files:
    """Opens, loads, saves and sends files. Its methods run in the worker's thread and return a sentence."""

    def __init__(self, session: Session, panels: Panels, state: Path, stages: Stages, cancelled: Callable[[], bool]):
        """Work for a session; what the app itself keeps goes to the folder `state`."""
        self._session, self._panels, self._state = session, panels, state
        self._stages: Stages = lambda number, prefix: stopping(stages(number, prefix), cancelled)
        self._cancelled = cancelled
        self._kept: Snapshot | None = None

    def open(self) -> str:
        """Open the scene that the panel names, with its cameras, and go on with the work that was kept of it."""
        panels = self._panels
        path = path_of(panels.path.value)
        if path is None:
            raise InputError("Give the path of a splat file first.")
        if is_project(path):
            return self.open_project(path)
        self._session.open(path, path_of(panels.camera_path.value), self._stages(4, ""))
        panels.start_afresh()
        self._kept = self._session.now
        if not self._autosave.is_file():
            return self._session.now.sentence
        try:
            return self._restore(self._autosave)
        except InputError as error:  # or cancelled
            return f"{self._session.now.sentence} The work of last time is not back: {error}"

    def open_project(self, path: Path) -> str:
        """Go on with a project: in the open scene if it is the project's, else in the scene that it names."""
        project, now = read_project(path), self._session.glance()
        if now is None or len(now.document.scene) != project.scene_size:
            self._panels.path.value = str(project.scene)
            self._panels.camera_path.value = str(project.cameras or "")
            self._session.open(project.scene, project.cameras, self._stages(4, ""))
            self._panels.start_afresh()
        return self._restore(path)

    def use_cameras(self) -> str:
        """Give the open scene the cameras that the panel names."""
        path = path_of(self._panels.camera_path.value)
        if path is None:
            raise InputError("Give the path of the cameras first.")
        self._session.use_cameras(path)
        return "The scene has these cameras now; your marks are kept, and understood with them."

    def load(self, path: Path | None) -> str:
        """Replace the active object's marks by those of a file."""
        if path is None:
            raise InputError("Give the path of a selection file first.")
        how = self._session.load(path)
        self._panels.look_at(controls.EVERYTHING, "Before", controls.OBJECTS)
        return f"{self._session.now.object.n_selected:,} Gaussians selected: {how}."

    def received(self, name: str, content: bytes, *, as_scene: bool | None = None) -> str:
        """Take a file that came from the browser, for what it is.

        Args:
            name: its name.
            content: what it holds.
            as_scene: whether splats are a scene, or else a selection cut out of the open one; None if nobody said.
        """
        folder = self._state / "files" / hashlib.sha256(content).hexdigest()[:16]
        path = folder / (Path(name).name or "file")
        private_folder(folder)
        write_private(path, content)
        if is_project(path):
            return self.open_project(path)
        if path.name in _CAMERA_NAMES:
            self._panels.camera_path.value = str(path)
            return self.use_cameras() if self._session.glance() is not None else "Now open the cameras' scene."
        if formats.has_splats(path) if as_scene is None else as_scene:
            self._panels.path.value, self._panels.camera_path.value = str(path), ""
            return self.open()
        return self.load(path)

    def save(self) -> str:
        """Save the active object's trim in the folder that the panel names."""
        target = self._panels.target
        self._panels.show_command(_saved(lambda: self._session.save(target)))
        return f"Saved in {target.folder}."

    def save_all(self) -> str:
        """Trim all objects together and save them in the folder that the panel names."""
        target, stages = self._panels.target, self._stages(2 * len(self._session.now.objects), "Trimming ")
        saved = _saved(lambda: self._session.save_objects(target, stages, self._cancelled))
        self._panels.show_command("")
        return f"{saved} saved in {target.folder}."

    def download(self, what: str, client: Any) -> str:
        """Send what the trim made to the browser: one of `DOWNLOADS`."""
        now = self._session.now
        result = now.object.result
        if result is None:
            raise InputError(f"'{now.object.name}' has not been cut out since it was marked; press 'Cut out' first.")
        name = safe_file_name(now.object.name)
        with TemporaryDirectory() as folder:
            if what == "Everything":
                file, data = f"{name}.zip", self._zipped(Path(folder) / name)
            else:
                path = self._written(result, what, Path(folder), name)
                file, data = path.name, path.read_bytes()
        client.send_file_download(file, data, save_immediately=True)
        return f"{file} ({len(data) / 1e6:.1f} MB) is among the browser's downloads."

    def download_project(self, client: Any) -> str:
        """Send the project to the browser."""
        now = self._session.now
        name = f"{now.document.path.name.split('.')[0]}.project.json"
        data = json.dumps(project_as_json(now, Path.cwd())).encode()
        client.send_file_download(name, data, save_immediately=True)
        return f"{name} is among the browser's downloads; drop it on the page to go on with it."

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
            write_project(now, self._autosave)
        else:
            self._autosave.unlink(missing_ok=True)

    @property
    def _autosave(self) -> Path:
        return autosave_path(self._state / "projects", self._session.document.scene)

    def _restore(self, path: Path) -> str:
        """Go on with a project of the open scene; undoing takes it away."""
        project = read_project(path)
        progress = self._stages(1 + len(project.objects), "Understanding ")
        self._session.restore(restored(project, self._session.document, progress))
        now = self._session.now
        n = sum(bool(part.marks) for part in now.objects)
        again = " What was cut out is being cut out again." if any(part.to_cut_out for part in now.objects) else ""
        return f"Your work is back: {n} object{'s' if n > 1 else ''} marked.{again} Undo takes it away. {now.sentence}"

    def _written(self, result: TrimResult, what: str, folder: Path, name: str) -> Path:
        """The path of one part of a trim, written into a folder."""
        if what == "Web page":
            path = folder / f"{name}.html"
            export_viewer(result, path)
            return path
        suffix = Target(folder, self._panels.ending).suffix(self._session.document)
        path = folder / f"{name if what == controls.OBJECT else f'without_{name}'}{suffix}"
        formats.write(self._placed(result.object if what == controls.OBJECT else result.background, result), path)
        return path

    def _placed(self, gaussians: Gaussians, result: TrimResult) -> Gaussians:
        return stood_upright(gaussians, result.up.direction) if self._panels.placed[controls.UPRIGHT] else gaussians

    def _zipped(self, folder: Path) -> bytes:
        """All that saving writes, as one file."""
        self._session.save(Target(folder, self._panels.ending))
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(folder.rglob("*")):
                archive.write(path, path.relative_to(folder.parent))
        return data.getvalue()


def ask_whether_scene(client: Any, name: str, answered: Callable[[bool], None]) -> None:
    """Ask in a tab whether splats are a scene or a selection, and call a function with the answer."""
    question = client.gui.add_modal(f"What is {name}?")

    def answer(as_scene: bool) -> None:
        question.close()
        answered(as_scene)

    with question:
        client.gui.add_button("A scene to open").on_click(lambda event: answer(True))
        client.gui.add_button("A selection of the open scene").on_click(lambda event: answer(False))


def path_of(text: str) -> Path | None:
    """The path that a field names, as browsers and file managers copy it, too; None if there is none."""
    text = text.strip().strip("\"'")
    return Path(text.removeprefix("file://")).expanduser() if text else None


def _saved(save: Callable[[], str]) -> str:
    """Return what saving returns; an error about earlier results names the app's own cure."""
    try:
        return save()
    except OutputExistsError as error:
        raise InputError(
            f"The folder '{error.folder}' is not empty; choose another one, or 'Replace' beside 'Earlier results'."
        ) from error
