"""`gaussian-trimmer trim`: a scene and rough selections in, sharp objects and a clean background out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from gaussian_trimmer import formats
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands.mark_options import MarkOptions
from gaussian_trimmer.commands.replay import inputs_of_report
from gaussian_trimmer.commands.scene_inputs import ReadScene, SceneInputs
from gaussian_trimmer.commands.trim_run import ResultOptions, SelectedScene, TrimRun
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.options import Names, Positional, arg
from gaussian_trimmer.selecting.lifting import lift_id_masks
from gaussian_trimmer.selecting.reading import read_selection, read_selection_result
from gaussian_trimmer.selecting.select import with_query_row
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.selection_files import SelectionOptions, load_objects
from gaussian_trimmer.selection_files.kinds import is_trimmed
from gaussian_trimmer.selection_files.selection_file import open_selection
from gaussian_trimmer.settings import check_settings, to_plain
from gaussian_trimmer.trimming.result import THE_OBJECT
from gaussian_trimmer.trimming.trim_options import TrimOptions


@dataclass(frozen=True)
class Trim:
    """Sharpen a rough selection of one object, or of several: write objects, the scene without them, and a report.

    Without SELECTION, and without anything else that says what to select, the file is taken to hold the object alone.
    """

    COMMON_OPTIONS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "the scene": ("--cameras", "--up", "--photos"),
        "several objects": ("--labels", "--exclude"),
        "how to trim": ("--views", "--segmenter", "--background", "--preset", "--config"),
        "results": ("--output", "--overwrite", "--format", "--for", "--html", "--json"),
    }
    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer trim scene.ply selection.npy --cameras sparse/0",
        "gaussian-trimmer trim scene.ply cut.ply --up z --output cup --html",
        "gaussian-trimmer trim scene.ply --labels labels.npy --cameras transforms.json",
        "gaussian-trimmer trim object.ply --up -y --for unreal",
        "gaussian-trimmer trim --config cup/report.json --output again",
    )

    inputs: Annotated[SceneInputs, arg(name="")]
    selection: Annotated[Positional[Path | None], arg(metavar="SELECTION")] = None
    """Which Gaussians roughly are the object. A mask, labels, row numbers, a PLY cut out of the scene, what a
    segmentation method saved, or marks saved as .json."""
    output: Annotated[Path | None, arg(metavar="DIR", default="trimmed/SCENE-SELECTION")] = None
    """Folder for the results."""
    selection_options: Annotated[SelectionOptions, arg(name="selection")] = field(default_factory=SelectionOptions)
    """How the selection file is read; the defaults suffice unless the file can be understood in several ways."""
    labels: Annotated[Path | None, arg(metavar="FILE")] = None
    """Trim several objects at once, in place of SELECTION. FILE has an id for each Gaussian, or is what a method with
    several objects saved, or a folder of masks whose pixels are ids. Each object becomes a file object_ID, and there is
    one background without all of them."""
    objects: Annotated[tuple[int, ...], arg(metavar="ID ...")] = ()
    """Which objects of --labels to trim; by default all whose ids are above zero."""
    exclude: Annotated[tuple[Path, ...], arg(metavar="FILE ...")] = ()
    """Selections of other objects, such as labels.npz of an earlier trim, whose Gaussians stay out of this one."""
    marks: Annotated[MarkOptions, arg(name="")] = field(default_factory=MarkOptions)
    options: Annotated[TrimOptions, arg(name="")] = field(default_factory=TrimOptions)
    results: Annotated[ResultOptions, arg(name="")] = field(default_factory=ResultOptions)

    @classmethod
    def presets(cls, given: Mapping[Names, Any]) -> dict[Names, Any]:
        """Return the files that the report named by --config read, unless others are given."""
        report = given.get(("options", "config_file"))
        return {} if report is None else inputs_of_report(report, given)

    def run(self, read: ReadScene = formats.read, note: Mapping[str, Any] = MappingProxyType({})) -> int:
        """Trim and write the results; return the exit code, 3 where nothing was trimmed.

        Args:
            read: reads the scene.
            note: what the report says among the inputs beside them.

        Raises:
            InputError: something that the user gave cannot be used; nothing has been written then.
        """
        console = self.results.console()
        to_read = self.to_read()
        self.check()
        run = TrimRun(
            folder=self.folder(),
            suffix=to_read.suffix(self.options),
            options=self.options,
            results=self.results,
            for_report=self.inputs.as_json(self.options) | self._for_report() | dict(note),
            files=self.files(),
            source=self.selection,
        )
        return run.run(console, lambda: self._read(to_read, console, read))

    def to_read(self) -> SceneInputs:
        """Return the scene to read: of a folder that is given as both scene and selection, the selection's own."""
        if self.selection != self.inputs.scene:
            return self.inputs
        return replace(self.inputs, scene=identify(self.inputs.scene).scene_and_selection)

    def folder(self) -> Path:
        """The folder for the results."""
        if self.output is not None:
            return self.output
        given = self.selection or self.labels
        names = [self.inputs.name, *([given.name.split(".")[0]] if given else [])]
        return Path("trimmed") / "-".join([*names, *map(str, self.objects or self.selection_options.object_id)])

    def check(self) -> None:
        """Refuse what is not possible, or cannot go together, before anything is read."""
        scene = self.inputs.scene
        given_last = self.selection is not None and identify(self.selection).kind in ("splats", "torch")
        if given_last and not identify(scene).may_be_scene:
            raise InputError(f"'{scene.name}' is not a splat file; the scene comes before the selection.")
        check_settings(self.options.settings())
        marks = self.marks.marks()
        if self.labels is None:
            return
        if self.selection is not None or marks:
            raise InputError("--labels says what to trim; leave SELECTION and marks out.")
        self.results.check_several()
        if hasattr(self.options.make_segmenter(), "own_cameras"):
            raise InputError(
                f"The segmenter '{self.options.segmenter}' has masks of one object; with --labels choose another, or "
                "give --labels a folder of masks whose pixels are ids."
            )

    def _read(self, to_read: SceneInputs, console: Console, read: ReadScene) -> SelectedScene:
        """Return the scene and what is selected in it, without what --exclude names."""
        scene, cameras = to_read.read(self.options, console, read)
        if self.labels is None:
            selections: dict[Any, Selection] = {THE_OBJECT: self._selected(scene, cameras, console)}
        else:
            selections = {number: Selection(mask) for number, mask in self._labelled(scene, cameras).items()}
        left, others = {}, np.zeros(len(scene), np.bool_)
        for path in self.exclude:
            others |= _rows_of(path, scene)
        for number, selection in selections.items():
            mask, removed = selection.mask & ~others, selection.excluded
            if not mask.any():
                what = "the selection" if self.labels is None else f"object {number}"
                raise InputError(f"Nothing is left of {what}, since --exclude takes all of it; leave a file out.")
            excluded = others if removed is None else others | removed
            left[number] = replace(selection, mask=mask, excluded=excluded)
        return SelectedScene(scene, cameras, left)

    def _selected(self, scene: Gaussians, cameras: CameraSet | None, console: Console) -> Selection:
        """Return what SELECTION and marks select."""
        options = self.selection_options
        if options.query_point is not None:
            views: list[str | int] = [*self.marks.view, *self.marks.view_index]
            options = with_query_row(options, scene, views[0] if views else None, cameras)
        return read_selection_result(
            self.selection,
            scene,
            options,
            self.marks.marks(),
            cameras=cameras,
            camera_path=self.inputs.cameras,
            up=self.options.config.up,
            say=console.print,
        )

    def _labelled(self, scene: Gaussians, cameras: CameraSet | None) -> dict[int, BoolArray]:
        """Return the objects of --labels, as masks (N,) by their ids."""
        assert self.labels is not None
        if not self.labels.is_dir():
            labels: NDArray[Any] = load_objects(self.labels, scene, self.objects, self.selection_options)
        else:
            labels, _ = lift_id_masks(scene, cameras, self.labels)
        present = [int(number) for number in np.unique(labels) if number > 0]
        if absent := sorted(set(self.objects) - set(present)):
            raise InputError(f"The masks in '{self.labels}' show no object {absent[0]}; they show {present[:24]}.")
        return {number: np.asarray(labels == number) for number in (self.objects or present)}

    def files(self) -> list[Path]:
        """Return the files, and folders of masks, that are read. A folder with cameras may hold the results as well."""
        cameras, labels = (
            path if path is not None and path.is_file() else None for path in (self.inputs.cameras, self.labels)
        )
        options = [vars(options) for options in (self.selection_options, self.options.used_options()) if options]
        within = (value for values in options for value in values.values())
        given = [self.inputs.scene, self.selection, cameras, labels, *self.exclude, *within, *self.marks.files]
        return [path for path in given if isinstance(path, Path)]

    def _for_report(self) -> dict[str, Any]:
        """Return what the report says of the selection."""
        return {
            "selection": str(self.selection) if self.selection else None,
            "selection_options": to_plain(self.selection_options),
            "labels": str(self.labels) if self.labels else None,
            "objects": list(self.objects),
            "exclude": [str(path) for path in self.exclude],
        }


def _rows_of(path: Path, scene: Gaussians) -> BoolArray:
    """Return which Gaussians of the scene a file for --exclude means, (N,)."""
    if path.suffix == ".npz" and is_trimmed(open_selection(path, len(scene))):
        return np.asarray(load_objects(path, scene) > 0)
    return read_selection(path, scene)
