"""Names of files and folders that every system accepts, made from any text."""

from __future__ import annotations

import unicodedata

_LONGEST = 150
"""Bytes; file systems allow 255, of which endings take some."""
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(10))}
"""Names that Windows keeps for devices, whatever ending they have."""


def safe_file_name(name: str, punctuation: str = "-_") -> str:
    """Return a name with _ in place of every character that is neither a letter or digit nor in `punctuation`.

    >>> safe_file_name("my scene 1.5"), safe_file_name("my scene 1.5", ".-_"), safe_file_name("NUL"), safe_file_name("")
    ('my_scene_1_5', 'my_scene_1.5', '_NUL', '_')
    """
    name = unicodedata.normalize("NFKC", name)
    safe = "".join(c if c.isalnum() or c in punctuation else "_" for c in name).lstrip(".-")
    safe = safe.encode()[:_LONGEST].decode(errors="ignore").rstrip(".")
    return f"_{safe}" if not safe or safe.partition(".")[0].casefold() in _DEVICES else safe
