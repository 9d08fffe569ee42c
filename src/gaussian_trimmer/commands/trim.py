"""`gaussian-trimmer trim`: a scene and a rough selection in, a sharp object and a clean background out."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
from rich.console import Console
from tyro.conf import Positional, arg

from gaussian_trimmer import formats
from gaussian_trimmer.atomic import atomic_folder
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet
from gaussian_trimmer.commands.console import open_console, print_summary, progress_over_stages
from gaussian_trimmer.compiling import CACHE
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.output import report
from gaussian_trimmer.pipeline import trim
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters import SEGMENTERS, Segmenter, get_segmenter
from gaussian_trimmer.segmentation.segmenters.grabcut import GrabCutConfig
from gaussian_trimmer.segmentation.segmenters.mask_files import MaskFilesConfig, cameras_with_masks
from gaussian_trimmer.segmentation.segmenters.sam2_video import Sam2Config
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

_COMPILING = "Compiling kernels, once per installation: about 20 seconds."
_COMPILING_AGAIN = (
    "Compiling kernels: about 20 seconds. They cannot be kept, since no folder for them is writable; "
    "set NUMBA_CACHE_DIR to one that is."
)
_SegmenterConfig = GrabCutConfig | Sam2Config | MaskFilesConfig


@dataclass(frozen=True)
class Trim:
    """Sharpen a rough selection of one object: write the object, the scene without it, a report and pictures.

    Without SELECTION the file is taken for the object alone.
    """

    scene: Positional[Path]
    """Splat file of the scene, or of the object alone."""
    selection: Annotated[Positional[Path | None], arg(metavar="SELECTION")] = None
    """Which Gaussians are the object, roughly: mask, labels, row numbers, a PLY with some of the rows, or what a
    segmentation method saved."""
    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json. They give the up vector and the angles from
    which the object was really seen."""
    output: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder for the results. (default: trimmed/SCENE-SELECTION)"""
    overwrite: bool = False
    """Replace earlier results in the output folder; files that the program did not write stay."""
    format: Annotated[str | None, arg(metavar="ENDING")] = None
    """Format of the object and the background, by its ending: ply, compressed.ply, splat, spz, sog or ksplat.
    (default: that of the scene)"""
    preset: Literal["fit", "paper"] = "fit"
    """Defaults of all settings below: this program's, or the GaussianTrimmer paper's."""
    views: Annotated[int | None, arg(metavar="INT")] = None
    """Number of virtual views, short for --plan.views."""
    segmenter: Annotated[str, arg(metavar="{" + ",".join(SEGMENTERS) + "}")] = "label-field"
    """What finds the object in the views."""
    renderer: Annotated[str, arg(metavar="{auto,numba,reference,gsplat}")] = "auto"
    """What renders the views; auto is gsplat where it is installed and finds a GPU, else numba."""
    quiet: bool = False
    """Print nothing but errors."""
    config: Annotated[TrimConfig, arg(name="")] = field(default_factory=TrimConfig)
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How the selection file is read; the defaults suffice wherever it says itself which Gaussians it means."""
    grabcut: GrabCutConfig = field(default_factory=GrabCutConfig)
    sam2: Sam2Config = field(default_factory=Sam2Config)
    mask_files: MaskFilesConfig = field(default_factory=MaskFilesConfig)

    def run(self, prepare: Callable[[], None] = lambda: None) -> None:
        """Trim and write the results.

        Args:
            prepare: called when the output folder has been found to be usable, before anything is read.

        Raises:
            InputError: something that the user gave cannot be used; nothing has been written then.
        """
        console = open_console(quiet=self.quiet)
        with self._results() as folder:
            prepare()
            start = time.perf_counter()
            with progress_over_stages(console) as stage:
                summary = self._write(folder, stage, console)
        print_summary(console, summary, time.perf_counter() - start)
        console.print(f"object{self._suffix()}, before_after.png and the rest are in {self._folder()}.")

    def _write(self, folder: Path, stage: Callable[[str], None], console: Console) -> dict[str, Any]:
        """Write the results to a folder; returns the report."""
        start = time.perf_counter()
        stage("read")
        scene, selection, cameras = self._read()
        seconds = {"read": time.perf_counter() - start}
        config, views = self._config(), self._given_views(cameras)
        renderer, segmenter = get_renderer(self.renderer), self._segmenter()
        if renderer.name == "numba" and not _kernels_are_compiled():
            console.print(_COMPILING if CACHE else _COMPILING_AGAIN)
        result = trim(scene, selection, config, renderer, segmenter, cameras, views, stage)
        stage("write")
        how = segmenter.describe() if hasattr(segmenter, "describe") else segmenter.name
        summary = report.describe(result, selection, config, self._inputs(), how, seconds)
        report.write_results(result, selection, summary, folder, renderer, self._suffix())
        return summary

    def _results(self) -> AbstractContextManager[Path]:
        """The folder to write to, locked against other runs; errors as those of `atomic_folder`."""
        return atomic_folder(
            self._folder(),
            "trim",
            names=report.result_files(self._suffix()),
            inputs=self._input_paths(),
            overwrite=self.overwrite,
        )

    def _suffix(self) -> str:
        if self.format is None:
            return formats.format_suffix(self.scene)
        suffix = f".{self.format.lower().lstrip('.')}"
        if suffix not in formats.FORMATS:
            known = ", ".join(name.lstrip(".") for name in formats.FORMATS)
            raise InputError(f"Unknown format '{self.format}'; available: {known}.")
        return suffix

    def _folder(self) -> Path:
        if self.output is not None:
            return self.output
        names = [self.scene.name.split(".")[0]] + ([self.selection.name.split(".")[0]] if self.selection else [])
        return Path("trimmed") / "-".join(names)

    def _input_paths(self) -> list[Path]:
        """Files, and folders of masks, that are read. A folder with cameras may hold the results as well."""
        cameras = self.cameras if self.cameras is not None and self.cameras.is_file() else None
        given = [self.scene, self.selection, cameras, self.selection_options.classifier]
        given += [self.mask_files.folder if self.segmenter == "mask-files" else None]
        return [path for path in given if path is not None]

    def _read(self) -> tuple[Gaussians, BoolArray, CameraSet | None]:
        scene = formats.read(self.scene)
        cameras = read_camera_set(self.cameras) if self.cameras else None
        if self.selection is None:
            return scene, np.ones(len(scene), np.bool_), cameras
        selection = load_selection(self.selection, scene, self.selection_options)
        if selection.all():
            raise InputError(
                f"'{self.selection}' selects all {len(scene)} Gaussians of '{self.scene}'; give the whole scene, or "
                "leave the selection out if the file holds the object alone."
            )
        return scene, selection, cameras

    def _config(self) -> TrimConfig:
        if self.views is None:
            return self.config
        return replace(self.config, plan=replace(self.config.plan, views=self.views))

    def _given_views(self, cameras: CameraSet | None) -> list[Camera] | None:
        """The cameras of the user's masks, if it is masks that segment."""
        if self.segmenter != "mask-files" or self.mask_files.folder is None:
            return None
        if cameras is None:
            raise InputError("The segmenter 'mask-files' needs the cameras of the masks' pictures: --cameras PATH.")
        return cameras_with_masks(cameras.pinhole_cameras(), self.mask_files.folder)

    def _segmenter_config(self) -> _SegmenterConfig | None:
        configs = {"grabcut": self.grabcut, "sam2": self.sam2, "mask-files": self.mask_files}
        return cast(_SegmenterConfig | None, configs.get(self.segmenter))

    def _segmenter(self) -> Segmenter:
        config = self._segmenter_config()
        return get_segmenter(self.segmenter, config) if config else get_segmenter(self.segmenter)

    def _inputs(self) -> dict[str, Any]:
        """Files and choices, as JSON holds them."""
        used = self._segmenter_config()
        return {
            "scene": str(self.scene),
            "selection": str(self.selection) if self.selection else None,
            "selection_options": _as_json(self.selection_options),
            "cameras": str(self.cameras) if self.cameras else None,
            "preset": self.preset,
            "segmenter_options": _as_json(used) if used else {},
        }


def _as_json(options: SelectionOptions | _SegmenterConfig) -> dict[str, Any]:
    return {name: str(value) if isinstance(value, Path) else value for name, value in asdict(options).items()}


def _kernels_are_compiled() -> bool:
    """Whether an earlier run has left the renderer's compiled kernels on disk."""
    from gaussian_trimmer.rendering.numba_kernels import blend_tiles

    return CACHE and any(Path(str(blend_tiles.stats.cache_path)).glob("numba_kernels.blend_tiles-*.nbi"))
