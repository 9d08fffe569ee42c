"""`gaussian-trimmer objects`: every object of a scene, without a click."""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from rich.console import Console

from gaussian_trimmer.batch.tables import FOUND_OBJECTS, write_table
from gaussian_trimmer.commands.console import in_lengths, print_up, progress_over_stages
from gaussian_trimmer.commands.scene_inputs import SceneInputs, changed_words, reading_words
from gaussian_trimmer.commands.trim_run import ResultOptions, SelectedScene, TrimRun
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.finding.found import FoundObjects, chosen_objects
from gaussian_trimmer.finding.judging import FindConfig
from gaussian_trimmer.finding.saving import FOUND_FILES, write_found
from gaussian_trimmer.io.manifest import is_made_of
from gaussian_trimmer.io.writing import atomic_folder, safe_file_name
from gaussian_trimmer.options import arg
from gaussian_trimmer.selecting.selection import Selection
from gaussian_trimmer.trimming.trim_options import TrimOptions
from gaussian_trimmer.trimming.up_vector import UpVector, find_up

_KIND = "objects"
_MOST_LISTED = 40


@dataclass(frozen=True)
class Objects:
    """Find every object of a scene: what stands on its surfaces, hangs from them or leans against them.

    Writes objects.npy with a number for each Gaussian, 0 for the rest; objects.csv with place, size, colour, how sure
    and why; index.html with a picture of each, on which to choose, merge, split and name, and which gives the command
    to go on; and batch.csv, from which 'batch' trims them. What the program is not sure of comes last, and is trimmed
    only if it is asked for.
    """

    COMMON_OPTIONS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "find": ("--cameras", "--up", "--surfaces"),
        "choose": ("--keep", "--merge", "--split-objects", "--names"),
        "results": ("--trim", "--output", "--for", "--html", "--overwrite", "--json"),
    }
    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "gaussian-trimmer objects scene.ply --cameras sparse/0",
        "gaussian-trimmer objects scene.ply --cameras sparse/0 --trim cut_out",
        "gaussian-trimmer objects scene.ply --keep 1 2 5 --merge 2+5 --names 1=mug --trim some",
    )

    inputs: Annotated[SceneInputs, arg(name="")]
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
    options: Annotated[TrimOptions, arg(name="")] = field(default_factory=TrimOptions)
    results: Annotated[ResultOptions, arg(name="")] = field(default_factory=ResultOptions)

    def run(self) -> None:
        """Find the objects and write them, then trim them if asked to.

        Raises:
            InputError: something that the user gave cannot be used.
        """
        console, overwrite = self.results.console(), self.results.overwrite
        names, merge = _named(self.names), [_group(text) for text in self.merge]
        folder, scene_file = self.output or Path("found") / self.inputs.name, self.inputs.scene
        self.results.check_several()
        if self.trim is None and (self.keep or self.merge or self.split_objects):
            raise InputError("--keep, --merge and --split-objects say what to trim; add --trim DIR.")
        found_files = atomic_folder(
            folder,
            _KIND,
            names=FOUND_FILES,
            inputs=[scene_file],
            source=scene_file,
            overwrite=overwrite or is_made_of(folder, scene_file),
        )
        start = time.perf_counter()
        with found_files as part, progress_over_stages(console) as stage:
            stage("read")
            scene, cameras = self.inputs.read(self.options, console)
            up = find_up(scene, cameras, self.options.config.up)
            print_up(console, up)
            found = find_objects(
                scene,
                cameras=cameras,
                up=up,
                config=self.find,
                progress=stage,
            )
            stage("write")
            document = write_found(found, part, command=self._next_command(), names=names)
            if sure := [str(one.id) for one in found if one.sure and one.kind == "object"]:
                write_table([self._batch_row(sure, folder, up)], part / FOUND_OBJECTS)
        _print_found(console, found, names, folder / "objects.csv")
        console.print(
            f"{folder}: {sum(one.sure for one in found)} objects, and "
            f"{sum(not one.sure for one in found)} that are unsure; time {time.perf_counter() - start:.1f} s"
        )
        if self.trim is None:
            now = shlex.join(self._next_command())
            now = f"To trim all that are sure: {now}" if sure else f"To trim some that are not: {now} --keep ID ..."
            console.print(f"To choose: open {folder / 'index.html'} in a browser. {now}")
            self.results.printing.print_json(document, (folder, _KIND))
            return
        chosen = chosen_objects(found, keep=self.keep or None, merge=merge, split=self.split_objects, names=names)
        numbered = all(name.isdigit() for name in chosen)  # then objects keep their numbers
        selections = {int(name) if numbered else name: Selection(mask) for name, mask in chosen.items()}
        self._run_of(self.trim, folder, list(selections)).run(
            console, lambda: SelectedScene(scene, cameras, selections, up)
        )

    def _run_of(self, folder: Path, found: Path, chosen: list[int | str]) -> TrimRun:
        """Return the trim of the chosen objects together."""
        ids = chosen if not (self.merge or self.split_objects or self.names) else []
        said = {"labels": str(found / "objects.npy"), "objects": ids} if ids else {}
        return TrimRun(
            folder=folder,
            suffix=self.inputs.suffix(self.options),
            options=self.options,
            results=self.results,
            for_report=self.inputs.as_json(self.options) | said,
            files=[self.inputs.scene],
        )

    def _batch_row(self, numbers: list[str], folder: Path, up: UpVector) -> dict[str, str]:
        """The row of a manifest that trims these objects one by one, named as the folder."""
        cameras = self.inputs.cameras
        return {
            "scene": str(self.inputs.scene.absolute()),
            "labels": "objects.npy",
            "objects": " ".join(numbers),
            "name": safe_file_name(folder.absolute().name),
            "cameras": str(cameras.absolute()) if cameras else "",
            "up": " ".join(map(repr, up.for_trims() or ())),
            "options": shlex.join(reading_words(self.options)),
        }

    def _next_command(self) -> list[str]:
        """The words of the command that finds the same objects again and trims them."""
        words = ["gaussian-trimmer", "objects", *self.inputs.words(self.options), *changed_words(self.find)]
        if self.output is not None:
            words += ["--output", str(self.output)]
        return [*words, "--trim", str(Path("trimmed") / self.inputs.name)]


def _print_found(console: Console, found: FoundObjects, names: dict[int, str], table: Path) -> None:
    listed = [one for one in found if one.sure] or list(found)
    for one in listed[:_MOST_LISTED]:
        called = f" {names[one.id]}" if one.id in names else ""
        console.print(f"object {one.id}{called}: {one.gaussians:,} Gaussians, {in_lengths(one.size)}, {one.why}")
    if len(listed) > _MOST_LISTED:
        console.print(f"{len(listed) - _MOST_LISTED} more are in {table}.")


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
