"""Files that appear whole or not at all, and signals that become an exception, so that what was begun is removed."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import sys
import threading
import time
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from gaussian_trimmer.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

HIDDEN_PREFIX = ".gaussian-trimmer"
"""Of the names that things have until they are whole."""
_SECONDS_UNTIL_LEFT_OVER = 24 * 3600.0
_SECONDS_UNTIL_RAISED_AGAIN = 0.05
_LONGEST = 150
"""Bytes; file systems allow 255, of which endings take some."""
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(10))}
"""Names that Windows keeps for devices, whatever ending they have."""


_written: dict[Path, None] | None = None
"""Files and folders that have been written whole since signals are raised, in order; None while they are not."""


class Stopped(KeyboardInterrupt):
    """A signal, whose number is the first argument, has asked the process to stop; a second says what that means.

    After a plain KeyboardInterrupt in `exec`, as in every dataclass, Python ends by SIGINT even if it was caught.
    """


@contextmanager
def stop_signals_raised() -> Iterator[list[int]]:
    """Raise `Stopped` when a signal asks the process to stop; yields the list of the signals that came.

    Whoever finds a signal in the list knows that an error of any type may be the interruption: amid an import it often
    ends in another one. Signals that are ignored, as under `nohup`, or handled by someone else stay so, and outside the
    main thread nothing changes. Finalizers, and callbacks of libraries in C, swallow what is raised in them: it is then
    raised again.
    """
    global _written
    received: list[int] = []
    before, report = {}, sys.unraisablehook
    _written = {}

    def stop(number: int, frame: object) -> None:
        received.append(number)
        raise Stopped(number)

    def raise_again(swallowed: sys.UnraisableHookArgs) -> None:
        if isinstance(swallowed.exc_value, Stopped):
            threading.Timer(_SECONDS_UNTIL_RAISED_AGAIN, interrupt, swallowed.exc_value.args[:1]).start()
        else:
            report(swallowed)

    def interrupt(number: int) -> None:
        main = threading.main_thread().ident
        if main is not None and _written is not None:  # else the command has ended
            signal.pthread_kill(main, number)  # also wakes it if it sleeps

    try:
        if hasattr(signal, "pthread_kill"):  # not on Windows
            sys.unraisablehook = raise_again
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                with suppress(ValueError):  # in another thread
                    before[number] = signal.signal(number, stop)
        yield received
    finally:
        _written, sys.unraisablehook = None, report
        for number, handler in before.items():
            signal.signal(number, handler)


def note_written(path: Path) -> None:
    """Note that a file or folder has been written whole, for whoever says that the command was stopped."""
    if _written is not None:
        _written[path] = None


def written() -> list[Path]:
    """Return what has been written whole since signals are raised."""
    return list(_written or ())


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write to; it replaces `path` on success and is removed on failure.

    Raises:
        InputError: the folder does not exist or cannot be written to, the disk is full, or `path` is a symbolic link,
            a folder or a device.
    """
    part = path.parent / f"{HIDDEN_PREFIX}-{os.urandom(6).hex()}.part"
    try:
        if os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
            raise InputError(f"Cannot write '{path}': it is not a regular file; choose another name.")
        remove_old_parts(path.parent)
        part.touch(exist_ok=False)
        yield part
        part.replace(path)
        if not any(part.startswith(HIDDEN_PREFIX) for part in path.parts):
            note_written(path)
    except OSError as error:
        raise InputError(f"Cannot write '{path}': {error.strerror or error}.") from error
    finally:
        with suppress(OSError):
            part.unlink()


def remove_old_parts(folder: Path) -> None:
    """Remove temporary files that dead runs have left in a folder, and that are a day old."""
    with suppress(OSError):
        for part in folder.glob(f"{HIDDEN_PREFIX}-*.part"):
            if time.time() - part.lstat().st_mtime > _SECONDS_UNTIL_LEFT_OVER:
                part.unlink()


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, where they are missing.

    Raises:
        InputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder '{folder}' cannot be made ({error.strerror}).") from error


def write_whole(path: Path, data: str | bytes | memoryview) -> None:
    """Write a small file, text as UTF-8, whole or not at all.

    Raises:
        InputError: as `atomic_file`.
    """
    with atomic_file(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


def state_folder() -> Path:
    """Return where the program keeps its own files on this machine.

    Raises:
        InputError: the user has no home.
    """
    try:
        return Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser() / "gaussian-trimmer"
    except RuntimeError as error:
        raise InputError("The user has no home.") from error


def private_folder(folder: Path) -> Path:
    """Make a folder that its user alone can enter, and return it.

    Raises:
        InputError: it cannot be made.
    """
    make_folder(folder)
    with suppress(OSError):  # a file system without permissions
        folder.chmod(0o700)
    return folder


def write_private(path: Path, data: str | bytes) -> None:
    """Write a file that its user alone can read; missing folders are made, and private.

    Raises:
        InputError: it cannot be written.
    """
    private_folder(path.parent)
    write_whole(path, data)
    with suppress(OSError):
        path.chmod(0o600)


def write_json(document: Any, path: Path) -> None:
    """Write JSON, whole or not at all.

    Raises:
        InputError: as `atomic_file`.
    """
    write_whole(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def write_table(rows: Sequence[Mapping[str, Any]], path: Path, *, for_people: bool = False) -> None:
    """Write rows, which have the same columns, as a .csv.

    Args:
        rows: at least one.
        path: the file.
        for_people: keep spreadsheets from taking a text for a formula, by an apostrophe before it.

    Raises:
        InputError: as `atomic_file`.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    writer.writerows([_as_text(cell) if for_people else cell for cell in row.values()] for row in rows)
    write_whole(path, text.getvalue())


def _as_text(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r")) else cell


def write_array(file: BinaryIO, array: NDArray[Any]) -> None:
    """Write the bytes of an array in C order; unlike `ndarray.tofile`, notice when the last of them do not fit.

    Raises:
        OSError: not all bytes could be written.
    """
    file.write(array.data if array.flags.c_contiguous else array.tobytes())


def npy_bytes(array: NDArray[Any]) -> bytes:
    """Return the bytes of an .npy file."""
    import numpy as np

    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def safe_file_name(name: str, punctuation: str = "-_") -> str:
    """Return a name with _ in place of every character that is neither a letter or digit nor in `punctuation`.

    >>> safe_file_name("my scene 1.5"), safe_file_name("my scene 1.5", ".-_"), safe_file_name("NUL"), safe_file_name("")
    ('my_scene_1_5', 'my_scene_1.5', '_NUL', '_')
    """
    name = unicodedata.normalize("NFKC", name)
    safe = "".join(c if c.isalnum() or c in punctuation else "_" for c in name).lstrip(".-")
    safe = safe.encode()[:_LONGEST].decode(errors="ignore").rstrip(".")
    return f"_{safe}" if not safe or safe.partition(".")[0].casefold() in _DEVICES else safe
