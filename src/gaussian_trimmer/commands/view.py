"""`gaussian-trimmer view`: the app in the browser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from gaussian_trimmer import formats
from gaussian_trimmer.app.serving import MOST_SHOWN, serving, wait
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.io.reading import is_file, is_folder
from gaussian_trimmer.io.stop_signals import Stopped
from gaussian_trimmer.options import Positional, arg
from gaussian_trimmer.settings import Range, check_settings


@dataclass(frozen=True)
class View:
    """Open the app in a browser: mark an object in the 3D view, trim it, look at it from all sides, correct, and save.

    Press Ctrl-C to stop. It needs the extra `app`. Only this machine can reach the app, and only under the address
    that is printed, whose last part is a key; from another machine, use a tunnel: ssh -L 8080:127.0.0.1:8080
    WORKSTATION.
    """

    scene: Annotated[Positional[Path | None], arg(metavar="SCENE")] = None
    """Splat file of the scene, or the folder of a training; without it, the app starts empty and offers the sample."""
    cameras: Annotated[Path | None, arg(metavar="PATH")] = None
    """Training cameras: a COLMAP folder, transforms.json or cameras.json."""
    port: Annotated[int, Range(0, 65535)] = 8080
    """Port to listen at; if it is taken, the next free port; 0 picks any."""
    max_shown: Annotated[int, Range(1000, 100_000_000)] = MOST_SHOWN
    """Show about this many Gaussians at most; larger scenes are thinned where they are far, but only for display."""
    browser: bool = True
    """Open the page in this machine's browser."""
    quiet: bool = False
    """Print nothing but the address and errors."""

    def run(self) -> int:
        """Serve until a signal comes.

        Raises:
            InputError: a setting is not possible, the scene or the extra is missing, or cameras have no scene.
        """
        check_settings(self)
        if self.scene is None and self.cameras is not None:
            raise InputError("--cameras needs a scene: give the scene that the cameras belong to.")
        for path in (self.scene, self.cameras):
            if path is not None and not (is_file(path) or is_folder(path)):
                raise InputError(f"There is no file '{path}'.")
        if self.scene is not None:
            formats.format_suffix(identify(self.scene).scene)
        console = open_console(quiet=False)
        with serving(self.scene, self.cameras, port=self.port, most=self.max_shown) as app:
            console.print(app.address)
            if not self.quiet:
                console.print("Press Ctrl-C to stop.")
            if self.browser:
                app.open_browser()
            try:
                wait()
            except Stopped as signal:  # as it always ends; what was saved meanwhile was said there
                raise Stopped(*signal.args, "Stopped.") from signal
        return 0
