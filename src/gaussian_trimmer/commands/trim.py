"""`gaussian-trimmer trim`: a scene and a rough selection in, a sharp object and a clean background out."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.atomic import atomic_folder
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.commands.console import open_console, print_summary, progress_over_stages, warn_of
from gaussian_trimmer.compiling import CACHE
from gaussian_trimmer.config import PlanConfig, TrimConfig, check_config
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.output.report import RESULTS, result_files
from gaussian_trimmer.output.saving import suffix_of, write_trim
from gaussian_trimmer.pipeline import trim
from gaussian_trimmer.rendering import DEFAULT_RENDERER, RENDERER_CHOICES, get_renderer
from gaussian_trimmer.segmentation.segmenters import (
    DEFAULT_SEGMENTER,
    SEGMENTERS,
    Segmenter,
    all_options,
    field_name,
    get_segmenter,
)
from gaussian_trimmer.selection_files import SelectionOptions, load_selection
from gaussian_trimmer.settings import check_settings

_COMPILING = "Compiling kernels, once per installation: about 20 seconds."
_COMPILING_AGAIN = (
    "Compiling kernels: about 20 seconds. They cannot be kept, since no folder for them is writable; "
    "set NUMBA_CACHE_DIR to one that is."
)
NOTHING_TRIMMED = 3
"""Exit code where the inputs could be read, but the selection was written as it came."""
_SegmenterOptions = all_options()
Loaded = tuple[Gaussians, BoolArray, CameraSet | None]
"""A scene, the rough selection (N,) and the cameras."""


@dataclass(frozen=True)
class Trim:
    """Sharpen a rough selection of one object: write the object, the scene without it, a report and pictures.

    Without SELECTION, the file is taken to hold the object alone.
    """

    scene: Positional[Path]
    """Splat file of the scene, or of the object alone."""
    selection: Annotated[Positional[Path | None], arg(metavar="SELECTION")] = None
    """Which Gaussians roughly are the object: a mask, labels, row numbers, a PLY with some of the rows, or a file
    that a segmentation method saved."""
    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They give the up vector and the range of
    angles from which the object was observed."""
    trust_paths: bool = False
    """Open pictures outside its folder that a transforms.json names, if it does not say their size."""
    output: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="(default: trimmed/SCENE-SELECTION)")] = None
    """Folder for the results."""
    overwrite: bool = False
    """Replace earlier results in the output folder; files that the program did not write stay."""
    format: Annotated[str | None, arg(metavar="ENDING", help_behavior_hint="(default: that of the scene)")] = None
    """File format of object and background: ply, compressed.ply, splat, spz, sog or ksplat."""
    preset: Literal["default", "paper"] = "default"
    """Defaults of all settings below: those of this program, or those of the GaussianTrimmer paper."""
    views: Annotated[int | None, arg(metavar="INT")] = None
    """Number of virtual views; short for --plan.views."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = DEFAULT_SEGMENTER
    """What segments the object in the views."""
    renderer: Annotated[str, arg(metavar="{" + ",".join(RENDERER_CHOICES) + "}")] = DEFAULT_RENDERER
    """What renders the views; auto is numba, on the CPU. gsplat, on a GPU, is for those who name it: its results
    have not been compared with the others' on a GPU yet."""
    quiet: bool = False
    """Print nothing but errors."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How the selection file is read; the defaults suffice unless the file can be understood in several ways."""
    segmenter_options: Annotated[Any, arg(name="", constructor=_SegmenterOptions)] = field(
        default_factory=_SegmenterOptions
    )

    def run(self, load: Callable[[], Loaded] | None = None) -> int:
        """Trim and write the results; returns the exit code, 3 where nothing was trimmed.

        Args:
            load: gives scene, selection and cameras instead of the files; called when the output folder can be used.

        Raises:
            InputError: something that the user gave cannot be used; nothing has been written then.
        """
        console = open_console(quiet=self.quiet)
        self._check_settings()
        with self._results() as folder:
            loaded = load() if load else None
            start = time.perf_counter()
            with progress_over_stages(console) as stage:
                summary = self._write(folder, loaded, stage, console)
        print_summary(console, summary, time.perf_counter() - start)
        console.print(f"object{self._suffix()}, before_after.png and the rest are in {self._folder()}.")
        warn_of(summary)
        return NOTHING_TRIMMED if summary["refused"] else 0

    def _write(
        self, folder: Path, loaded: Loaded | None, stage: Callable[[str], None], console: Console
    ) -> dict[str, Any]:
        """Trim and write the results to a folder; returns the report."""
        start = time.perf_counter()
        stage("read")
        scene, selection, cameras = loaded or self._read()
        self._refuse_whole_scene(selection)
        seconds = {"read": time.perf_counter() - start}
        config, renderer, segmenter = self._config(), get_renderer(self.renderer), self._segmenter()
        views = segmenter.own_cameras(cameras) if hasattr(segmenter, "own_cameras") else None
        self._refuse_unused_views(views)
        if renderer.name == "numba" and not _kernels_are_compiled():
            console.print(_COMPILING if CACHE else _COMPILING_AGAIN)
        result = trim(
            scene, selection, config=config, renderer=renderer, segmenter=segmenter, cameras=cameras,
            view_cameras=views, progress=stage,
        )  # fmt: skip
        stage("write")
        return write_trim(result, folder, self._suffix(), self._inputs(), seconds)

    def _results(self) -> AbstractContextManager[Path]:
        """The folder to write to, locked against other runs; errors as those of `atomic_folder`."""
        return atomic_folder(
            self._folder(),
            RESULTS,
            names=result_files(self._suffix()),
            inputs=self._input_paths(),
            overwrite=self.overwrite,
        )

    def _check_settings(self) -> None:
        """Refuse settings that are not possible before anything is read, also those that this run would not use."""
        check_config(self._config())
        check_settings(self.selection_options, "selection")
        check_settings(self.segmenter_options)

    def _suffix(self) -> str:
        if self.format is None:
            return formats.format_suffix(self.scene)
        return suffix_of(self.format)

    def _folder(self) -> Path:
        if self.output is not None:
            return self.output
        names = [self.scene.name.split(".")[0]] + ([self.selection.name.split(".")[0]] if self.selection else [])
        return Path("trimmed") / "-".join(names)

    def _input_paths(self) -> list[Path]:
        """Files, and folders of masks, that are read. A folder with cameras may hold the results as well."""
        cameras = self.cameras if self.cameras is not None and self.cameras.is_file() else None
        options = [vars(options) for options in (self.selection_options, self._used_options()) if options]
        given = [self.scene, self.selection, cameras, *(value for values in options for value in values.values())]
        return [path for path in given if isinstance(path, Path)]

    def _read(self) -> Loaded:
        scene = formats.read(self.scene)
        cameras = read_camera_set(self.cameras, trust_paths=self.trust_paths) if self.cameras else None
        if self.selection is None:
            return scene, np.ones(len(scene), np.bool_), cameras
        return scene, load_selection(self.selection, scene, self.selection_options), cameras

    def _refuse_whole_scene(self, selection: BoolArray) -> None:
        if self.selection is not None and selection.all():
            raise InputError(
                f"'{self.selection}' selects all {len(selection)} Gaussians of '{self.scene}'; give the whole scene, "
                "or leave the selection out if the file holds the object alone."
            )

    def _refuse_unused_views(self, given: list[Camera] | None) -> None:
        """A number of virtual views means nothing where the views are those of the user's masks."""
        wished = self.config.plan.views if self.views is None else self.views
        if given is not None and (self.views is not None or wished != PlanConfig().views):
            raise InputError(
                f"The segmenter '{self.segmenter}' looks from the cameras of its {len(given)} masks, so {wished} "
                "virtual views cannot be had; leave --views and --plan.views out, or remove masks from their folder."
            )

    def _config(self) -> TrimConfig:
        if self.views is None:
            return self.config
        return replace(self.config, plan=replace(self.config.plan, views=self.views))

    def _used_options(self) -> Any:
        """The options of the segmenter that is used, or None if it has none."""
        return getattr(self.segmenter_options, field_name(self.segmenter), None)

    def _segmenter(self) -> Segmenter:
        options = self._used_options()
        return get_segmenter(self.segmenter, options) if options else get_segmenter(self.segmenter)

    def _inputs(self) -> dict[str, Any]:
        """Files and choices, for the report."""
        used = self._used_options()
        return {
            "scene": str(self.scene),
            "selection": str(self.selection) if self.selection else None,
            "selection_options": _as_json(self.selection_options),
            "cameras": str(self.cameras) if self.cameras else None,
            "preset": self.preset,
            "segmenter_options": _as_json(used) if used else {},
        }


def _as_json(options: Any) -> dict[str, Any]:
    return {name: str(value) if isinstance(value, Path) else value for name, value in asdict(options).items()}


def _kernels_are_compiled() -> bool:
    """Whether an earlier run has left the renderer's compiled kernels on disk."""
    from gaussian_trimmer.rendering.numba_kernels import blend_tiles

    return CACHE and any(Path(str(blend_tiles.stats.cache_path)).glob("numba_kernels.blend_tiles-*.nbi"))
