"""The command line: a table of commands, each imported when it is called, and how errors are reported."""

from __future__ import annotations

import io
import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import Protocol, cast

from gaussian_trimmer import __version__
from gaussian_trimmer.errors import InputError, printable

PROGRAM = "gaussian-trimmer"

# Name -> module, dataclass of the options, and a line of help.
COMMANDS = {
    "trim": ("gaussian_trimmer.commands.trim", "Trim", "sharpen a rough selection of one object"),
    "demo": ("gaussian_trimmer.commands.demo", "Demo", "trim an object of the sample scene"),
    "info": ("gaussian_trimmer.commands.info", "Info", "say what a splat, selection or camera file holds"),
    "convert": ("gaussian_trimmer.commands.convert", "Convert", "convert between splat formats"),
    "select": ("gaussian_trimmer.commands.select", "Select", "make a rough selection from a click, a box or masks"),
}

USER_ERROR, INTERRUPTED = 2, 130
_MESSAGE_LENGTH = 1000


class Command(Protocol):
    """What the dataclass of a command has besides its options."""

    def run(self) -> None:
        """Do the work."""
        ...


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code.

    What the user can correct is reported in one sentence on standard error, with code 2; an interruption gives code
    130. Other exceptions are defects of the program and keep their traceback.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    for stream in (sys.stdout, sys.stderr):
        # A name with an umlaut must not end in a traceback where the terminal knows ASCII alone.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # Threads that spin while they wait for each other halve the speed where another program keeps a core busy.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")  # Warnings of libraries tell a user nothing; `python -W` shows them.
        try:
            return _dispatch(arguments)
        except InputError as error:
            return _fail(str(error))
        except OSError as error:
            place = f": '{error.filename}'" if error.filename else ""
            return _fail(f"{error.strerror or error}{place}.")
        except MemoryError:
            return _fail("There is not enough memory for this.")
        except KeyboardInterrupt:
            return INTERRUPTED


def _dispatch(arguments: Sequence[str]) -> int:
    name = arguments[0] if arguments else "--help"
    if name in ("-h", "--help"):
        print(_overview())
    elif name == "--version":
        print(f"{PROGRAM} {__version__}")
    elif name in COMMANDS:
        _parse(name, arguments[1:]).run()
    else:
        raise InputError(f"Unknown command '{name}'; available: {', '.join(COMMANDS)}.")
    return 0


def _parse(name: str, arguments: Sequence[str]) -> Command:
    import tyro

    module, attribute, _ = COMMANDS[name]
    kind = getattr(import_module(module), attribute)
    command = tyro.cli(kind, prog=f"{PROGRAM} {name}", args=arguments)
    if getattr(command, "preset", "") == "paper":
        from gaussian_trimmer.config import paper_config
        from gaussian_trimmer.segmentation.segmenters import PAPER_SEGMENTER, paper_options

        # Parsed once more over the preset's values, so that what the user set beside it still counts.
        default = replace(
            command, config=paper_config(), segmenter=PAPER_SEGMENTER,
            segmenter_options=paper_options(command.segmenter_options),
        )  # fmt: skip
        command = tyro.cli(kind, prog=f"{PROGRAM} {name}", args=arguments, default=default)
    return cast(Command, command)


def _overview() -> str:
    lines = [f"  {name:<9}{text}" for name, (_, _, text) in COMMANDS.items()]
    return "\n".join([
        f"usage: {PROGRAM} COMMAND ...", "", "Sharp object boundaries for 3D Gaussian Splatting segmentations.", "",
        *lines, "", f"{PROGRAM} COMMAND --help lists the options of a command; --version names the version.",
    ])  # fmt: skip


def _fail(message: str) -> int:
    print(f"{PROGRAM}: {printable(' '.join(message.split()), _MESSAGE_LENGTH)}", file=sys.stderr)
    return USER_ERROR
