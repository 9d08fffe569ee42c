"""`gaussian-trimmer view`: the app in the browser."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Annotated

from gaussian_trimmer import formats
from gaussian_trimmer.app.serving import MOST_SHOWN, serving, wait
from gaussian_trimmer.commands.arguments import CAMERAS
from gaussian_trimmer.commands.console import open_console
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.io.reading import is_file, is_folder
from gaussian_trimmer.io.writing import Stopped
from gaussian_trimmer.parser import Parser
from gaussian_trimmer.settings import Range

ABOUT = """Open the app in a browser: mark an object, trim it, look at it from all sides, correct, and save.

Press Ctrl-C to stop. It needs the extra `app`. Only this machine can reach the app, and only under the address that is
printed, whose last part is a key; from another machine, use a tunnel: ssh -L 8080:127.0.0.1:8080 WORKSTATION."""


def add_arguments(parser: Parser) -> None:
    """Say what the command takes."""
    parser.describe(ABOUT, run)
    scene = (
        "Splat file of the scene, or the folder of a training; without it, the app starts empty and offers the sample"
    )
    parser.add_argument("scene", kind=Path, nargs="?", metavar="SCENE", help=scene)
    parser.add_argument("--cameras", kind=Path, help=CAMERAS)
    port = "Port to listen at; if it is taken, the next free port; 0 picks any"
    parser.add_argument("--port", kind=Annotated[int, Range(0, 65535)], default=8080, help=port)
    shown = "Show about this many Gaussians at most; larger scenes are thinned where they are far, for display alone"
    parser.add_argument("--max-shown", kind=Annotated[int, Range(1000, 100_000_000)], default=MOST_SHOWN, help=shown)
    parser.add_argument("--browser", kind=bool, default=True, help="Open the page in this machine's browser")
    parser.add_argument("--quiet", kind=bool, help="Print nothing but the address and errors")


def run(arguments: Namespace) -> None:
    """Serve until a signal comes.

    Raises:
        InputError: the scene or the extra is missing, or cameras have no scene.
    """
    scene, cameras = arguments.scene, arguments.cameras
    if scene is None and cameras is not None:
        raise InputError("--cameras needs a scene: give the scene that the cameras belong to.")
    for path in (scene, cameras):
        if path is not None and not (is_file(path) or is_folder(path)):
            raise InputError(f"There is no file '{path}'.")
    if scene is not None:
        formats.format_suffix(identify(scene).scene)
    console = open_console(quiet=False)
    with serving(scene, cameras, port=arguments.port, most=arguments.max_shown) as app:
        console.print(app.address)
        if not arguments.quiet:
            console.print("Press Ctrl-C to stop.")
        if arguments.browser:
            app.open_browser()
        try:
            wait()
        except Stopped as signal:  # as it always ends; what was saved meanwhile was said there
            raise Stopped(*signal.args, "Stopped.") from signal
