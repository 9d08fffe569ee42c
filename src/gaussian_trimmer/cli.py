"""The command line: a table of commands, each imported when it is called, and how errors are reported."""

from __future__ import annotations

# Nothing that takes long is imported here: until `main` runs, Ctrl-C would end in a traceback.
import io
import os
import sys
from contextlib import suppress

from gaussian_trimmer._version import __version__
from gaussian_trimmer.commands import COMMANDS, command_in, parser_of
from gaussian_trimmer.errors import InputError, did_you_mean, printable, user_message

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

PROGRAM = "gaussian-trimmer"

USER_ERROR, INTERRUPTED, STOPPED_BY = 2, 130, 128
"""Exit codes; that of a run which a signal stopped is 128 and the signal's number, as shells have it. `Command.run` may
return others."""
_SIGPIPE = 13
"""Its number; Windows has no such signal."""
_MESSAGE_LENGTH = 1000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code.

    What the user can mend is one sentence on standard error and code 2. Where nothing was trimmed, the selection was
    written as it came, and the code is 3. Ctrl-C is code 130, SIGTERM 143 and SIGHUP 129; what was begun is removed,
    and a sentence says what is left. Other exceptions are defects and keep their traceback.
    """
    try:
        from gaussian_trimmer.io.writing import stop_signals_raised, written

        with stop_signals_raised() as signals:
            try:
                code = _run(sys.argv[1:] if arguments is None else list(arguments))
            except BaseException as error:
                # Whatever follows a signal follows from it.
                if not signals:
                    return _explain(error)
                _say_stopped(error, written())
            return STOPPED_BY + signals[0] if signals else code
    except KeyboardInterrupt as stopped:  # before or after what stands above takes the signals
        return STOPPED_BY + stopped.args[0] if stopped.args else INTERRUPTED


def _run(arguments: Sequence[str]) -> int:
    import warnings

    for stream in (sys.stdout, sys.stderr):
        # A name with an umlaut must not end in a traceback where the terminal knows ASCII alone.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # Threads that wait for each other lose their time to whatever else runs: a product of small matrices then takes
    # fifty times as long.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")  # Warnings of libraries tell a user nothing; `python -W` shows them.
        code = _dispatch(arguments)
        print(end="", flush=True)  # what cannot be written is an error here, and not when Python ends
        return code


def _explain(error: BaseException) -> int:
    """Print what the user can mend, and raise the rest again."""
    if isinstance(error, BrokenPipeError):  # such as of `| head`, which has seen enough
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains when it ends
        return STOPPED_BY + _SIGPIPE
    message = user_message(error)
    if message is None:
        raise error
    print(f"{PROGRAM}: {printable(' '.join(message.split()), _MESSAGE_LENGTH)}", file=sys.stderr)
    return USER_ERROR


def _say_stopped(error: BaseException, written: Sequence[object]) -> None:
    """Say that a signal has stopped the command, and what it has written; what the error says comes first."""
    left = f"{', '.join(map(str, written))} had been written." if written else "nothing was written."
    said = error.args[1] if len(error.args) > 1 and isinstance(error, KeyboardInterrupt) else f"Stopped; {left}"
    with suppress(OSError):  # the terminal may be gone
        print(f"{PROGRAM}: {printable(said, _MESSAGE_LENGTH)}", file=sys.stderr)


def _dispatch(words: Sequence[str]) -> int:
    name, further = command_in(words) if words else ("--help", ())
    if name in ("-h", "--help"):
        print(_overview())
    elif name == "--version":
        print(f"{PROGRAM} {__version__}")
    elif name in COMMANDS and "--help-all" in further:
        print(parser_of(name).format_help_all())
    elif name in COMMANDS and {"-h", "--help"}.intersection(further):
        print(parser_of(name).format_help())
    elif name in COMMANDS:
        arguments = parser_of(name).parse(further)
        return arguments.run(arguments) or 0
    else:
        from gaussian_trimmer.commands.gone import GONE

        cure = did_you_mean(name, COMMANDS) or f"available: {', '.join(COMMANDS)}."
        raise InputError(f"'{name}' is gone. {GONE[name]}" if name in GONE else f"Unknown command '{name}'; {cure}")
    return 0


def _overview() -> str:
    width = max(map(len, COMMANDS)) + 2
    lines = [f"  {name:<{width}}{text}" for name, (_, text) in COMMANDS.items()]
    head = f"usage: {PROGRAM} COMMAND ...\n\nSharp object boundaries for 3D Gaussian Splatting segmentations.\n"
    tail = f"\n{PROGRAM} COMMAND --help shows the options of a command, --help-all also every setting.\n"
    tail += f"{PROGRAM} --version prints the version."
    return "\n".join([head, *lines, tail])
