"""The pages for a browser that commands write beside their results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from gaussian_trimmer.commands.console import refuse_existing
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.options import arg
from gaussian_trimmer.output.html.report_page import REPORT
from gaussian_trimmer.output.html.viewer import Part, check_page_name, export_viewer
from gaussian_trimmer.trimming.result import TrimResult


@dataclass(frozen=True)
class PageOptions:
    """Pages of a trim, which open without a server and without the network."""

    html: bool = False
    """Also write report.html, one page with views before and after and all numbers."""
    export_viewer: Annotated[Path | None, arg(metavar="FILE.html")] = None
    """Also write a page that draws the object in any browser, up to a million Gaussians."""
    viewer_part: Part = "object"
    """What that page shows."""

    def wished(self) -> bool:
        """Whether there is a page to write."""
        return self.html or self.export_viewer is not None

    def check(self, folder: Path, *, overwrite: bool) -> None:
        """Refuse a page that could not be written, before anything is read.

        Args:
            folder: the folder of the results, in which the page may lie.
            overwrite: whether the page may be replaced.

        Raises:
            InputError: the name does not end with .html, is that of the report, or exists, or its folder is missing.
        """
        if self.export_viewer is None:
            return
        check_page_name(self.export_viewer)
        if self._within(folder) is None:
            refuse_existing(self.export_viewer, overwrite=overwrite)
        elif self.export_viewer.name == REPORT:
            raise InputError(f"'{self.export_viewer}' is the name of the page that --html writes; choose another name.")

    def sentence(self) -> str:
        """What there is to open."""
        shown = "object and background" if self.viewer_part == "both" else f"the {self.viewer_part}"
        return f"{self.export_viewer} shows {shown} in any browser."

    def names(self, folder: Path) -> tuple[str, ...]:
        """Name of the viewer among the results, if it lies there."""
        name = self._within(folder)
        return () if name is None else (name,)

    def write_viewer(self, result: TrimResult, folder: Path, part: Path) -> None:
        """Write the viewer if there is to be one.

        Args:
            result: the trim.
            folder: the folder of the results.
            part: where its files are written until all of them are there.

        Raises:
            InputError: there is nothing to show or too much, or the file cannot be written.
        """
        if self.export_viewer is not None:
            name = self._within(folder)
            export_viewer(result, part / name if name else self.export_viewer, self.viewer_part, overwrite=True)

    def _within(self, folder: Path) -> str | None:
        """The name of the viewer if it lies in a folder itself."""
        if self.export_viewer is None or self.export_viewer.parent.resolve() != folder.resolve():
            return None
        return self.export_viewer.name
