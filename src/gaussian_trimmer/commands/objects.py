"""`gaussian-trimmer objects`: every object of a scene, without a click."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, ClassVar

from rich.console import Console

from gaussian_trimmer.batch.manifest import write_manifest
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.commands.console import open_console, print_up, progress_over_stages
from gaussian_trimmer.commands.trim_inputs import TrimInputs
from gaussian_trimmer.commands.trim_objects import print_objects
from gaussian_trimmer.commands.trim_settings import TrimSettings
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.editing import chosen_objects
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.finding.found import FoundObjects
from gaussian_trimmer.finding.judging import FindConfig
from gaussian_trimmer.finding.saving import FOUND_FILES, write_found
from gaussian_trimmer.gaussians import BoolArray, Gaussians
from gaussian_trimmer.io.manifest import is_made_of
from gaussian_trimmer.io.names import safe_file_name
from gaussian_trimmer.io.writing import atomic_folder
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.output.saving import RESULTS, result_files, write_trim
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.segmentation.segmenters import Segmenter
from gaussian_trimmer.segmentation.segmenters.sam import SamSegmenter
from gaussian_trimmer.settings import check_settings
from gaussian_trimmer.trimming.trim import trim_objects

_KIND = "objects"
_MOST_LISTED = 40


@dataclass(frozen=True)
class Objects(TrimSettings):
    """Find every object of a scene: what stands on its surfaces, hangs from them or leans against them.

    Writes objects.npy with a number for each Gaussian, 0 for the rest; objects.csv with place, size, colour, how sure
    and why; index.html with a picture of each, on which to choose, merge, split and name, and which gives the command
    to go on; and batch.csv, from which 'batch' trims them. What the program is not sure of comes last, and is trimmed
    only if it is asked for. With --segmenter sam the model is also asked which things that touch are one.
    """

    COMMON_OPTIONS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "find": ("--cameras", "--up", "--surfaces"),
        "choose": ("--keep", "--merge", "--split-objects", "--names"),
        "results": ("--trim", "--output", "--html", "--overwrite", "--quiet"),
    }
    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer objects scene.ply --cameras sparse/0",
        "gaussian-trimmer objects scene.ply --cameras sparse/0 --trim all",
        "gaussian-trimmer objects scene.ply --keep 1 2 5 --merge 2+5 --names 1=mug --trim some",
    )

    scene: Annotated[Positional[Path], arg(metavar="SCENE")]
    """Splat file of the scene, or the folder of a training."""
    output: Annotated[Path | None, arg(metavar="DIR", default="found/SCENE")] = None
    """Folder for labels, table and page. Earlier ones of the same kind are replaced."""
    find: Annotated[FindConfig, arg(name="")] = field(default_factory=FindConfig)
    keep: Annotated[tuple[int, ...], arg(metavar="ID ...")] = ()
    """Trim these objects; without it, all that are sure."""
    merge: Annotated[tuple[str, ...], arg(metavar="ID+ID ...")] = ()
    """Objects that are one, such as 3+4."""
    split_objects: Annotated[tuple[int, ...], arg(metavar="ID ...")] = ()
    """Objects that are several; each falls apart into its main parts."""
    names: Annotated[tuple[str, ...], arg(metavar="ID=NAME ...")] = ()
    """What to call objects, such as 1=mug."""
    trim: Annotated[Path | None, arg(metavar="DIR")] = None
    """Also trim the objects, with all settings of trim, and write them and one scene without them to this folder."""

    def run(self) -> None:
        """Find the objects and write them, then trim them if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        console = open_console(quiet=self.quiet)
        check_settings(self)
        names, merge = _named(self.names), [_group(text) for text in self.merge]
        folder = self.output or Path("found") / self._name()
        if self.pages.export_viewer is not None or self.photos is not None:
            raise InputError("--export-viewer and --photos are for one object; leave them out.")
        if self.trim is None and (self.keep or self.merge or self.split_objects):
            raise InputError("--keep, --merge and --split-objects say what to trim; add --trim DIR.")
        results = atomic_folder(
            folder,
            _KIND,
            names=FOUND_FILES,
            inputs=[self.scene],
            source=self.scene,
            overwrite=self.overwrite or is_made_of(folder, self.scene),
        )
        renderer, model = get_renderer(self.renderer), self.make_segmenter() if self.segmenter == "sam" else None
        assert model is None or isinstance(model, SamSegmenter)
        start = time.perf_counter()
        with results as part, progress_over_stages(console) as stage:
            stage("read")
            reader = TrimInputs(self.scene, level=self.level, cameras=self.cameras, trust_paths=self.trust_paths)
            cameras = reader.read_cameras(console)
            scene = reader.read_scene(console)
            found = find_objects(
                scene,
                cameras=cameras,
                up=self.config.up,
                config=self.find,
                renderer=renderer,
                segmenter=model,
                progress=stage,
            )
            stage("write")
            write_found(found, part, renderer, command=self._next_command(), names=names)
            if sure := [str(one.id) for one in found if one.sure and one.kind == "object"]:
                write_manifest([self._batch_row(sure, folder)], part / "batch.csv")
        print_up(console, found.up)
        _print_found(console, found, names)
        console.print(
            f"{folder}: {sum(one.sure for one in found)} objects, and "
            f"{sum(not one.sure for one in found)} that are unsure; time {time.perf_counter() - start:.1f} s"
        )
        if self.trim is None:
            console.print(f"To choose: open {folder / 'index.html'} in a browser. Now: {self._next_text()}")
            return
        chosen = chosen_objects(found, keep=self.keep or None, merge=merge, split=self.split_objects, names=names)
        self._trim(console, scene, chosen, cameras, model or self.make_segmenter(), start)

    def _trim(
        self,
        console: Console,
        scene: Gaussians,
        chosen: dict[str, BoolArray],
        cameras: CameraSet | None,
        segmenter: Segmenter,
        start: float,
    ) -> None:
        """Trim the chosen objects together, and write them."""
        assert self.trim is not None
        suffix = TrimInputs(self.scene, format=self.format).suffix()
        numbered = all(name.isdigit() for name in chosen)  # then objects keep their numbers
        trimmed = atomic_folder(
            self.trim,
            RESULTS,
            names=result_files(suffix, several=True, html=self.pages.html),
            inputs=[self.scene],
            overwrite=self.overwrite,
        )
        with trimmed as part, progress_over_stages(console) as stage:
            result = trim_objects(
                scene,
                {int(name): mask for name, mask in chosen.items()} if numbered else chosen,
                config=self.settings(),
                renderer=get_renderer(self.renderer),
                segmenter=segmenter,
                cameras=cameras,
                progress=stage,
            )
            stage("write")
            cameras_path = str(self.cameras) if self.cameras else None
            inputs = {"scene": str(self.scene), "level": self.level, "cameras": cameras_path}
            report = write_trim(result, part, suffix, inputs, html=self.pages.html)
        print_objects(console, report, self.trim, suffix, start, html=self.pages.html)

    def _batch_row(self, numbers: list[str], folder: Path) -> dict[str, str]:
        """The row of a manifest that trims these objects one by one, named as the folder."""
        up = self.config.up or ()
        return {
            "scene": str(self.scene.absolute()),
            "labels": "objects.npy",
            "objects": " ".join(numbers),
            "name": safe_file_name(folder.absolute().name),
            "cameras": str(self.cameras.absolute()) if self.cameras else "",
            "up": " ".join(repr(float(value)) for value in up),
            "options": shlex.join([*self._level(), *(["--trust-paths"] if self.trust_paths else [])]),
        }

    def _name(self) -> str:
        return (self.scene.name or self.scene.resolve().name).split(".")[0]

    def _next_command(self) -> list[str]:
        """The words of the command that finds the same objects again and trims them."""
        words = ["gaussian-trimmer", "objects", str(self.scene), *self._level()]
        if self.cameras:
            words += ["--cameras", str(self.cameras), *(["--trust-paths"] if self.trust_paths else [])]
        if self.config.up:
            words += ["--up", *(f"{value:g}" for value in self.config.up)]
        for option in fields(FindConfig):
            value = getattr(self.find, option.name)
            if value != option.default:
                words += [f"--{option.name.replace('_', '-')}", *([] if value is True else [f"{value:g}"])]
        if self.segmenter == "sam":
            words += ["--segmenter", "sam", "--sam.model", self.used_options().model]
        if self.output is not None:
            words += ["--output", str(self.output)]
        return [*words, "--trim", str(Path("trimmed") / self._name())]

    def _level(self) -> list[str]:
        return [] if self.level is None else ["--level", str(self.level)]

    def _next_text(self) -> str:
        return shlex.join(self._next_command())


def _print_found(console: Console, found: FoundObjects, names: dict[int, str]) -> None:
    for one in found.objects[:_MOST_LISTED]:
        if one.sure:
            size = " x ".join(f"{value:.2g}" for value in one.size)
            called = f" {names[one.id]}" if one.id in names else ""
            console.print(f"object {one.id}{called}: {one.gaussians:,} Gaussians, {size}, {one.why}")


def _named(texts: tuple[str, ...]) -> dict[int, str]:
    names = {}
    for text in texts:
        number, _, name = text.partition("=")
        if not number.isdigit() or not name:
            raise InputError(f"'{text}' names no object; write its number and what to call it, such as 1=mug.")
        names[int(number)] = name
    return names


def _group(text: str) -> list[int]:
    if not re.fullmatch(r"\d+(\+\d+)+", text):
        raise InputError(f"'{text}' merges nothing; write the numbers of the objects, such as 3+4.")
    return [int(number) for number in text.split("+")]
