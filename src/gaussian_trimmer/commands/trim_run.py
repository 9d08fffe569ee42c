"""What `trim`, `select --trim` and `objects --trim` do: trim rough objects, and write and say the results."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import Camera, CameraSet, up_frame
from gaussian_trimmer.commands.console import (
    PrintOptions,
    announce_compiling,
    print_warnings,
    progress_over_stages,
)
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import Gaussians
from gaussian_trimmer.geometry.bounds import robust_bounds
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.masks import Segmenter
from gaussian_trimmer.masks.photographs import PhotoSegmenter, cameras_with_photos
from gaussian_trimmer.options import arg
from gaussian_trimmer.output.engines import PlacingOptions
from gaussian_trimmer.output.report import describe, sentences
from gaussian_trimmer.output.saving import PAGE, PICTURE, RESULTS, result_files, write_trim
from gaussian_trimmer.selecting.marks import Click, write_marks
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.settings import to_plain
from gaussian_trimmer.trimming.arguments import refuse_whole_scene
from gaussian_trimmer.trimming.config import TrimConfig
from gaussian_trimmer.trimming.result import title_of
from gaussian_trimmer.trimming.trim import trim_objects
from gaussian_trimmer.trimming.trim_options import TrimOptions, views_of_masks
from gaussian_trimmer.trimming.up_vector import UpVector, find_up
from gaussian_trimmer.views.photo_views import photo_views, visible_share

_USUAL_PHOTOS = 8
"""Number of photographs that are looked at, unless more views or another number are asked for."""
NOTHING_TRIMMED = 3
"""Exit code where the inputs could be read, but the selections were written unchanged."""
_LISTED = 4
MARKS = "selection.json"
"""Name of the file of marks among the results."""


@dataclass(frozen=True, kw_only=True)
class ResultOptions:
    """What is written beside object and background, and what is said."""

    photos: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the training pictures, in which to segment the object in place of virtual views. Those that show it
    best are taken. Needs --cameras."""
    placing: Annotated[PlacingOptions, arg(name="")] = field(default_factory=PlacingOptions)
    write_background: bool = True
    """Write the scene without the objects. It is nearly as large as the scene; labels.npz says which of the scene's
    Gaussians are in it."""
    overwrite: bool = False
    """Replace earlier results in the output folder. Other files in it are left alone."""
    printing: Annotated[PrintOptions, arg(name="")] = field(default_factory=PrintOptions)
    log_level: Literal["debug", "info", "warning", "error"] | None = None
    """Log each stage on standard error."""
    html: bool = False
    """Also write report.html, one page with views before and after and all numbers."""

    def console(self) -> Console:
        """Return what to print to."""
        return self.printing.console(self.log_level)

    def check_several(self) -> None:
        """Refuse what a trim of several objects would have to ignore.

        Raises:
            InputError: something of it is asked for.
        """
        if self.photos is not None:
            raise InputError("--photos is for one object; leave it out, or trim the objects one by one.")


@dataclass(frozen=True, eq=False)
class SelectedScene:
    """What is read before a trim: a scene, and what is selected in it."""

    scene: Gaussians
    cameras: CameraSet | None
    selections: Mapping[Any, Selection]
    """By the objects' ids or names."""
    up: UpVector | None = None
    """What was found for the whole scene; if it is sure, no object searches for its own."""

    @property
    def first(self) -> Selection:
        """The selection of the first object; marks and photographs are for one alone."""
        return next(iter(self.selections.values()))


@dataclass(frozen=True)
class TrimRun:
    """One trim, from its inputs to its folder."""

    folder: Path
    suffix: str
    """Ending of the splat files."""
    options: TrimOptions
    results: ResultOptions
    for_report: Mapping[str, Any]
    """Files and choices, as the report names them."""
    files: Sequence[Path]
    """Files, and folders of masks, that are read, and that results may not replace."""
    source: Path | None = None
    """The file that the results are made of, for the manifest."""

    def run(self, console: Console, read: Callable[[], SelectedScene]) -> int:
        """Trim and write the results; return the exit code, 3 where nothing was trimmed.

        Args:
            console: where to say what becomes of it.
            read: gives the rough objects; called once the folder for the results can be used.

        Raises:
            InputError: something that the user gave cannot be used; nothing has been written then.
        """
        start = time.perf_counter()
        with self._locked_folder() as part, progress_over_stages(console) as stage:
            stage("read")
            selected = read()
            marks = selected.first.marks
            clicked = marks is not None and all(isinstance(mark, Click) for mark in marks.marks)
            if self.source is not None and not clicked:  # a click means what is seen there, also if that is all
                for selection in selected.selections.values():
                    refuse_whole_scene(selection.mask, self.source, self.for_report["scene"])
            seconds = {"read": time.perf_counter() - start}
            report, said = self._write(part, selected, seconds, stage, console)
        titles = [title_of(entry["name"]) for entry in report["objects"]]
        for title, sentence in zip([*titles, "background"], sentences(report), strict=True):
            console.print(f"{title}: {sentence}")
        console.print(f"{self._where(report)} {time.perf_counter() - start:.1f} s.")
        for sentence in said:
            console.print(sentence)
        print_warnings(report)
        self.results.printing.print_json(report, (self.folder, RESULTS))
        return NOTHING_TRIMMED if all(entry["refused"] for entry in report["objects"]) else 0

    def _settings(self, up: UpVector | None) -> TrimConfig:
        """The settings of the trim, with what was found of the up vector where cameras do not tell it."""
        settings, found = self.options.settings(), up and up.for_trims()
        return replace(settings, up=found) if found and settings.up is None else settings

    def _locked_folder(self) -> Any:
        """The folder to write to, locked against other runs; errors as those of `atomic_folder`."""
        return atomic_folder(
            self.folder,
            RESULTS,
            names=(
                *result_files(self.suffix, html=self.results.html),
                MARKS,
                *self.results.placing.patterns(self.suffix),
            ),
            inputs=self.files,
            source=self.source,
            overwrite=self.results.overwrite,
        )

    def _write(
        self,
        part: Path,
        selected: SelectedScene,
        seconds: dict[str, float],
        stage: Callable[[str], None],
        console: Console,
    ) -> tuple[dict[str, Any], list[str]]:
        """Trim and write the results to a folder; return the report, and what to say of the files."""
        segmenter = self.options.make_segmenter()
        views = views_of_masks(segmenter, selected.cameras, self.options.settings())
        if self.results.photos is not None:
            views, segmenter = self._photo_views(selected, self.results.photos, segmenter)
        announce_compiling(console)
        result = trim_objects(
            selected.scene,
            selected.selections,
            config=self._settings(selected.up),
            segmenter=segmenter,
            cameras=selected.cameras,
            view_cameras=views,
            progress=stage,
        )
        stage("write")
        for_report = dict(self.for_report) | self._choices()
        if selected.first.marks is not None:
            write_marks(selected.first.marks, part / MARKS)
            for_report["marks"] = MARKS
        report = describe(result, for_report, seconds, self.suffix)
        background = self.results.write_background
        write_trim(result, report, part, self.suffix, background=background, html=self.results.html)
        placing, said = self.results.placing, list[str]()
        if placing.wished:
            files = placing.write(result, part, self.suffix, background=background)
            said.append(placing.sentence(files, result.objects[0].up))
        own = Path(self.for_report["scene"]).name
        same = self.options.format is None or formats.is_named(own, self.suffix)
        source = self.suffix if same else Path(own).suffix.lower()
        if lost := formats.losses(selected.scene, self.suffix, source):
            said.append(lost)
        return report, said

    def _choices(self) -> dict[str, Any]:
        """What the report says beside the configuration, so that `--config` makes the same trim again."""
        options, used = self.options, self.options.used_options()
        photos = str(self.results.photos) if self.results.photos else None
        return {
            "preset": options.preset, "segmenter": options.segmenter,
            "segmenter_options": to_plain(used) if used else {},
            "format": options.format, "photos": photos, "placing": to_plain(self.results.placing),
            "write_background": self.results.write_background,
        }  # fmt: skip

    def _photo_views(
        self, selected: SelectedScene, photos: Path, segmenter: Segmenter
    ) -> tuple[list[Camera], Segmenter]:
        """Return crops of the training pictures that show the object best, and the segmenter that is shown these."""
        if selected.cameras is None or hasattr(segmenter, "own_cameras"):
            raise InputError("--photos needs the cameras that took the pictures, --cameras, and a segmenter for them.")
        selection = selected.first.mask
        listed = zip(selected.cameras.pinhole_cameras(), selected.cameras.train, strict=True)
        known = cameras_with_photos([camera for camera, train in listed if train], photos)
        settings = self.options.settings()
        up = find_up(selected.scene, selected.cameras, settings.up, selection)
        bounds = robust_bounds(selected.scene.select(selection), up_frame(up.direction))
        number = self.options.views or max(settings.plan.views, _USUAL_PHOTOS)
        share = partial(visible_share, selected.scene, selection)
        views = photo_views(known, bounds, number, settings.plan.size, settings.plan.fill, share)
        if not views:
            raise InputError(f"None of the {len(known)} cameras with pictures in '{photos}' sees the object.")
        return views, PhotoSegmenter(segmenter, photos, known)

    def _where(self, report: Mapping[str, Any]) -> str:
        """Say where the results are."""
        files = [entry["file"] for entry in report["objects"] if entry["file"]]
        files = files if len(files) <= _LISTED else [f"{files[0]} to {files[-1]}"]
        files += (
            [f"background{self.suffix}"] if self.results.write_background and report["counts"]["background"] else []
        )
        looked_at = PAGE if self.results.html else PICTURE
        return f"{', '.join([*files, looked_at])} and the rest are in {self.folder}."
