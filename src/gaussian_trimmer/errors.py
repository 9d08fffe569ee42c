"""Exceptions for problems in what the user gave, and how text from files is shown."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # at start-up, an import of these takes longer than what they are for
    from collections.abc import Iterable

_MESSAGE_LENGTH = 1000
_NAME_LENGTH = 80


class InputError(ValueError):
    """An input cannot be used; the message is one sentence that says why and what to do.

    The command line prints the message and exits with code 2; every other exception is a defect of this package.

    Messages repeat what files and their names say, so characters that a terminal would obey are escaped, and a
    message of more than 1000 characters loses its middle.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message, _MESSAGE_LENGTH))


class OutputExistsError(InputError):
    """A folder for results is not empty, and replacing earlier results was not asked for."""

    def __init__(self, folder: object) -> None:
        super().__init__(
            f"The folder '{folder}' is not empty; choose another one, or replace earlier results: --overwrite, or in "
            "Python overwrite=True."
        )


class FolderInUseError(InputError):
    """Another run is writing to a folder."""


def printable(text: str, length: int | None = None) -> str:
    r"""The text on one line, without characters that move a cursor, change colours or turn the reading direction.

    White space becomes a space, other characters that are not printable an escape sequence of Python's, and a text
    that is longer than `length` loses its middle.

    >>> printable("a\nb\x1b[31m")
    'a b\\x1b[31m'
    >>> printable("abcdefghijklmnop", 10)
    'abcd...nop'
    """
    if length is not None and len(text) > length:  # cut first, so that escaping takes no time that grows with the text
        text = _without_middle(text, length)
    if not text.isprintable():
        text = "".join(c if c.isprintable() else " " if c in "\t\n\r" else _escape(c) for c in text)
    return text if length is None or len(text) <= length else _without_middle(text, length)


def clip_name(name: str) -> str:
    """A name from a file as a message or a listing shows it: printable, and no longer than a line.

    >>> clip_name("x" * 200) == "x" * 39 + "..." + "x" * 38
    True
    """
    return printable(name, _NAME_LENGTH)


def first_line(error: Exception) -> str:
    """Return what an error of another package says first, without a full stop, or its type if it says nothing.

    >>> first_line(ValueError("Not a model.\\nMore of it."))
    'Not a model'
    """
    return (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")[:300]


def user_message(error: BaseException) -> str | None:
    """What a user is told of an error that is not a defect of this package; None if it is one."""
    match error:
        case InputError():
            return str(error)
        case OSError():
            place = f": '{error.filename}'" if error.filename else ""
            return f"{error.strerror or error}{place}."
        case MemoryError():
            return "There is not enough memory for this."
        case RuntimeError() if "can't start new thread" in str(error):
            return "There is not enough memory for another thread, or the system allows no more; end other programs."
    return None


def did_you_mean(word: str, known: Iterable[str]) -> str | None:
    """A question after the known word that is most like a mistyped one; None if none is like it.

    >>> did_you_mean("trimm", ["select", "trim"]), did_you_mean("gamma", ["plan.gammas", "selection.gamma"])
    ('did you mean trim?', 'did you mean selection.gamma?')
    """
    from difflib import get_close_matches  # takes 10 ms, which a run without mistakes need not spend

    known = list(known)
    similar = [one for one in known if one.endswith(f".{word}")] or get_close_matches(word, known, 1)
    return f"did you mean {similar[0]}?" if similar else None


def _without_middle(text: str, length: int) -> str:
    tail = (length - 3) // 2
    return f"{text[: length - 3 - tail]}...{text[len(text) - tail :]}"


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
