"""`gaussian-trimmer trim`: a scene and a rough selection in, a sharp object and a clean background out."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.commands.console import (
    announce_compiling,
    open_console,
    print_json,
    print_refusal,
    print_summary,
    print_warnings,
    progress_over_stages,
)
from gaussian_trimmer.commands.trim_inputs import TrimInputs
from gaussian_trimmer.commands.trim_objects import trim_labels
from gaussian_trimmer.config import check_config
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.geometry.bounds import robust_bounds, up_frame
from gaussian_trimmer.io.reading import is_folder
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.output.engines import ENGINES, engine_files, write_for_engine
from gaussian_trimmer.output.html.report_page import REPORT
from gaussian_trimmer.output.saving import PICTURE, RESULTS, result_files, write_trim
from gaussian_trimmer.planning.photo_views import photo_views, visible_share
from gaussian_trimmer.planning.up_vector import find_up
from gaussian_trimmer.rendering import Renderer, get_renderer
from gaussian_trimmer.segmentation.segmenters import Segmenter
from gaussian_trimmer.segmentation.segmenters.photographs import PhotoSegmenter, cameras_with_photos
from gaussian_trimmer.selecting.marks import Marks
from gaussian_trimmer.selecting.marks_file import write_marks
from gaussian_trimmer.selecting.selection_input import read_selected_and_removed
from gaussian_trimmer.selecting.view_lookup import with_query_row
from gaussian_trimmer.settings import check_settings, to_plain
from gaussian_trimmer.trimming.arguments import refuse_whole_scene
from gaussian_trimmer.trimming.options import views_of_masks
from gaussian_trimmer.trimming.trim import trim

_USUAL_PHOTOS = 8
"""Number of photographs that are looked at, unless more views or another number are asked for."""
NOTHING_TRIMMED = 3
"""Exit code where the inputs could be read, but the selection was written unchanged."""
MARKS = "selection.json"
"""Name of the file of marks among the results."""


class Loaded(NamedTuple):
    """What is read before a trim."""

    scene: Gaussians
    selection: BoolArray
    """The selection, (N,)."""
    cameras: CameraSet | None
    marks: Marks | None = None
    """The marks that made the selection, if marks did."""
    excluded: BoolArray | None = None
    """What may not join the object, (N,): those marks removed it, or another object has it."""


@dataclass(frozen=True)
class Trim(TrimInputs):
    """Sharpen a rough selection of one object: write the object, the scene without it, a report and pictures.

    Without SELECTION, and without anything else that says what to select, the file is taken to hold the object alone.
    """

    def run(self, load: Callable[[], Loaded] | None = None) -> int:
        """Trim and write the results; returns the exit code, 3 where nothing was trimmed.

        Args:
            load: gives scene, selection and cameras instead of the files; called when the output folder can be used.

        Raises:
            InputError: something that the user gave cannot be used; nothing has been written then.
        """
        console = open_console(quiet=self.quiet or self.json, log_level=self.log_level)
        self._check_settings()
        if self.labels is not None:
            trim_labels(self, console)
            return 0
        with self._results() as folder:
            loaded = load() if load else None
            start = time.perf_counter()
            with progress_over_stages(console) as stage:
                report = self._write(folder, loaded, stage, console)
        if report["refused"]:
            print_refusal(report)
        print_summary(console, report, time.perf_counter() - start)
        self._say_where(console)
        print_warnings(report)
        if self.json:
            print_json(report, (self.folder(), RESULTS))
        return NOTHING_TRIMMED if report["refused"] else 0

    def _say_where(self, console: Console) -> None:
        """Say where the results are."""
        looked_at = REPORT if self.pages.html else PICTURE
        console.print(f"object{self.suffix()}, {looked_at} and the rest are in {self.folder()}.")
        if self.engine is not None:
            made = " and ".join(name for name in engine_files(self.engine) if (self.folder() / name).is_file())
            console.print(f"For {ENGINES[self.engine].name}, upright there: {made}.")
        if self.pages.export_viewer is not None:
            console.print(self.pages.sentence())

    def _write(
        self, folder: Path, loaded: Loaded | None, stage: Callable[[str], None], console: Console
    ) -> dict[str, Any]:
        """Trim and write the results to a folder; returns the report."""
        start = time.perf_counter()
        stage("read")
        loaded = loaded or self._read(console)
        scene, selection, excluded = loaded.scene, *self.without_excluded(loaded)
        if self.selection is not None:
            refuse_whole_scene(loaded.selection, self.selection, self.scene)
        seconds = {"read": time.perf_counter() - start}
        renderer, segmenter = get_renderer(self.renderer), self.make_segmenter()
        views = views_of_masks(segmenter, loaded.cameras, self.settings())
        if self.photos is not None:
            views, segmenter = self._photo_views(scene, selection, loaded.cameras, segmenter, renderer)
        if renderer.name == "numba":
            announce_compiling(console)
        result = trim(
            scene,
            selection,
            config=self.settings(),
            renderer=renderer,
            segmenter=segmenter,
            cameras=loaded.cameras,
            view_cameras=views,
            excluded=excluded,
            progress=stage,
        )
        stage("write")
        if loaded.marks is not None:
            write_marks(loaded.marks, folder / MARKS)
        report = write_trim(result, folder, self.suffix(), self._inputs(), seconds, html=self.pages.html)
        if self.engine is not None:
            write_for_engine(result, self.engine, folder)
        self.pages.write_viewer(result, self.folder(), folder)
        return report

    def without_excluded(self, loaded: Loaded) -> tuple[BoolArray, BoolArray | None]:
        """The selection without what --exclude names, and all that may not join the object.

        Raises:
            InputError: nothing of the selection is left.
        """
        others = self.excluded_rows(loaded.scene)
        selection = loaded.selection & ~others
        if not selection.any():
            raise InputError("Nothing is left of the selection, since --exclude takes all of it; leave a file out.")
        return selection, others if loaded.excluded is None else others | loaded.excluded

    def _results(self) -> AbstractContextManager[Path]:
        """The folder to write to, locked against other runs; errors as those of `atomic_folder`."""
        engine = engine_files(self.engine) if self.engine is not None else ()
        pages = self.pages.names(self.folder())
        return atomic_folder(
            self.folder(),
            RESULTS,
            names=(*result_files(self.suffix(), html=self.pages.html), MARKS, *engine, *pages),
            inputs=self._input_paths(),
            source=self.selection,
            overwrite=self.overwrite,
        )

    def _check_settings(self) -> None:
        """Refuse settings that are not possible before anything is read, also those that this run would not use."""
        if self.selection is not None and formats.has_splats(self.selection) and not _may_hold_splats(self.scene):
            raise InputError(f"'{self.scene.name}' is not a splat file; the scene comes before the selection.")
        check_config(self.settings())
        check_settings(self.selection_options, "selection")
        check_settings(self.segmenter_options)
        check_settings(self.mark_options)
        self.mark_options.marks()
        self.pages.check(self.folder(), overwrite=self.overwrite)

    def _input_paths(self) -> list[Path]:
        """Files, and folders of masks, that are read. A folder with cameras may hold the results as well."""
        cameras = self.cameras if self.cameras is not None and self.cameras.is_file() else None
        options = [vars(options) for options in (self.selection_options, self.used_options()) if options]
        given = [
            self.scene,
            self.selection,
            cameras,
            *self.exclude,
            *(value for values in options for value in values.values()),
        ]
        return [path for path in (*given, *self.mark_options.files) if isinstance(path, Path)]

    def _read(self, console: Console) -> Loaded:
        scene, cameras, options = self.read_scene(console), self.read_cameras(console), self.selection_options
        if options.query_point is not None:
            views: list[str | int] = [*self.mark_options.view, *self.mark_options.view_index]
            options = with_query_row(options, scene, views[0] if views else None, cameras, get_renderer(self.renderer))
        selection, excluded, marks = read_selected_and_removed(
            self.selection,
            scene,
            options,
            self.mark_options.marks(),
            cameras=cameras,
            camera_path=self.cameras,
            up=self.config.up,
            renderer=self.renderer,
            say=console.print,
        )
        return Loaded(scene, selection, cameras, marks, excluded)

    def _photo_views(
        self,
        scene: Gaussians,
        selection: BoolArray,
        cameras: CameraSet | None,
        segmenter: Segmenter,
        renderer: Renderer,
    ) -> tuple[list[Camera], Segmenter]:
        """Crops of the training pictures that show the object best, and the segmenter that is shown these pictures."""
        if self.photos is None or cameras is None or hasattr(segmenter, "own_cameras"):
            raise InputError("--photos needs the cameras that took the pictures, --cameras, and a segmenter for them.")
        listed = zip(cameras.pinhole_cameras(), cameras.train, strict=True)
        known = cameras_with_photos([camera for camera, train in listed if train], self.photos)
        up = find_up(scene, cameras, self.settings().up, selection)
        bounds = robust_bounds(scene.select(selection), up_frame(up.direction))
        plan = self.settings().plan
        number = self.views or max(plan.views, _USUAL_PHOTOS)
        shown = partial(visible_share, scene, selection, renderer=renderer)
        views = photo_views(known, bounds, number, plan.size, plan.fill, shown)
        if not views:
            raise InputError(f"None of the {len(known)} cameras with pictures in '{self.photos}' sees the object.")
        return views, PhotoSegmenter(segmenter, self.photos, known)

    def _inputs(self) -> dict[str, Any]:
        """Files and choices, for the report."""
        used = self.used_options()
        return {
            "scene": str(self.scene),
            "level": self.level,
            "selection": str(self.selection) if self.selection else None,
            "selection_options": to_plain(self.selection_options),
            "cameras": str(self.cameras) if self.cameras else None,
            "photos": str(self.photos) if self.photos else None,
            "for": self.engine,
            "exclude": [str(path) for path in self.exclude],
            "preset": self.preset,
            "segmenter_options": to_plain(used) if used else {},
        }


def _may_hold_splats(path: Path) -> bool:
    return formats.has_splats(path) or is_folder(path)
