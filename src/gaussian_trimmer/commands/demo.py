"""`gaussian-trimmer demo`: trims the lighthouse of the sample scene."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from gaussian_trimmer import sample
from gaussian_trimmer.commands.console import PrintOptions, open_console
from gaussian_trimmer.commands.scene_inputs import SceneInputs
from gaussian_trimmer.commands.trim import Trim
from gaussian_trimmer.commands.trim_run import ResultOptions
from gaussian_trimmer.options import arg

_FOLDER = Path("trimmed") / "demo"


@dataclass(frozen=True)
class Demo:
    """Trim an object of the sample scene that comes with the program, and say where the results are."""

    output: Annotated[Path | None, arg(metavar="DIR", default="trimmed/demo")] = None
    """Folder for the results. Every run replaces those in trimmed/demo."""
    overwrite: bool = False
    """Replace earlier results in the output folder. Other files in it are left alone."""
    quiet: bool = False
    """Print nothing but errors."""

    def run(self) -> int:
        """Trim and write the results; exit code and errors are those of `Trim.run`."""
        console = open_console(quiet=self.quiet)
        console.print(
            "The sample: a toy lighthouse on a table, roughly selected, with parts of the table around its foot."
        )
        folder = self.output or _FOLDER
        code = Trim(
            SceneInputs(sample.SCENE, sample.CAMERAS),
            sample.SELECTION,
            output=folder,
            results=ResultOptions(
                overwrite=self.overwrite or self.output is None,
                printing=PrintOptions(quiet=self.quiet),
                html=True,
            ),
        ).run()
        console.print(
            f"\nLook first at {folder / 'report.html'} in a browser: before and after, and what was done.\n"
            f"{folder / 'before_after.png'}: selection, trimmed object and the scene without it, in one picture.\n"
            f"{folder / 'object.ply'} and {folder / 'background.ply'}: for any splat viewer.\n"
            f"{folder / 'views'}: where the outline was drawn. {folder / 'report.json'}: all numbers."
        )
        console.print("The same by hand:")
        command = ["gaussian-trimmer", "trim", sample.SCENE, sample.SELECTION, "--cameras", sample.CAMERAS, "--html"]
        console.print(f"  {shlex.join(map(str, command))}")
        return code
