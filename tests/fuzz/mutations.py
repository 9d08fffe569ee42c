"""Ways to damage a file: bytes, numbers and words anywhere, and what archives and JSON documents hold."""

from __future__ import annotations

import gzip
import io
import json
import random
import re
import struct
import zipfile
import zlib
from typing import Any

LARGEST_FILE = 5_000_000
_NUMBERS = (0, 1, 2, 3, 7, 8, 40, 255, 256, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1)
_FLOATS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-45,
    1e-30,
    1e19,
    1e30,
    -1e30,
    3.4e38,
    89.0,
    float("nan"),
    float("inf"),
    -float("inf"),
)
_SIGNALLING = (b"\x01\x7c", b"\x01\x00\x80\x7f", b"\x01\x00\x00\x00\x00\x00\xf0\x7f")
"""NaN of half, single and double precision that makes processors complain."""
_WORDS = (
    b"", b"0", b"-1", b"40", b"nan", b"-inf", b"1e30", b"1e400", b"99999999999999999999", b"1" * 5000, b"1_0", b"null",
    b"[]", b"{}", b"(", b"'", b"\x1b]0;owned\x07\x1b[2J", b"\xff\xfe", b"\x00", b"../../etc/passwd", b"\r\n", b"#",
    b"[" * 2000, "ä\u202e\ud800".encode("utf-8", "surrogatepass"), b"float", b"double", b"list uchar int", b"ascii",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 40, 65536, 10**9, 2**63, 10**400, 0.5, 1e-30, 1e19, 1e308, float("nan"), float("inf"), "",
    "\x1b[2J\x07", "x" * 20_000, "../../etc/passwd", "/etc/passwd", "a\x00b", "\ud800", [], {}, [[]], [1], {"a": 1},
    [0.0] * 256, [None] * 256, [1e308] * 3,
)  # fmt: skip


def mutate(rng: random.Random, data: bytes) -> bytes:
    """The data changed in one to three ways."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        inside = next((way for start, way in _INSIDE.items() if data.startswith(start)), None)
        ways = [_bytes, _numbers, _words] + [inside] * 4 * (inside is not None)
        try:
            data = rng.choice(ways)(rng, data)
        except Exception:  # what is changed already may not have its structure any more
            data = _bytes(rng, data)
    return data[:LARGEST_FILE]


def _at(rng: random.Random, data: bytes) -> int:
    """A place in the data, in the first bytes more often than later."""
    return rng.randrange(max(1, min(len(data), rng.choice((16, 64, 256, 5120, len(data), len(data))))))


def _bytes(rng: random.Random, data: bytes) -> bytes:
    """Bytes changed, cut out, doubled or cut off."""
    at, size = _at(rng, data), rng.choice((1, 1, 2, 4, 8, 100, 1000))
    match rng.randrange(4):
        case 0:
            return data[:at] + rng.randbytes(len(data[at : at + size])) + data[at + size :]
        case 1:
            return data[:at] + data[at + size :]
        case 2:
            return data[:at] + data[at : at + size] * rng.choice((2, 10)) + data[at + size :]
        case _:
            return data[:at]


def _numbers(rng: random.Random, data: bytes) -> bytes:
    """A number in binary overwritten by one that is rarely met."""
    kind = rng.choice("BHIQfds")
    if kind == "s":
        number = rng.choice(_SIGNALLING)
    elif kind in "fd":
        number = struct.pack(f"<{kind}", rng.choice(_FLOATS))
    else:
        size = struct.calcsize(kind)
        number = (rng.choice(_NUMBERS) % (1 << 8 * size)).to_bytes(size, rng.choice(("little", "little", "big")))
    at = _at(rng, data)
    at -= at % len(number) if rng.random() < 0.7 else 0
    return data[:at] + number + data[at + len(number) :]


def _words(rng: random.Random, data: bytes) -> bytes:
    """A word of a text replaced or doubled."""
    spans = [match.span() for match in re.finditer(rb"[^\s,:\[\]{}()]+", data[:100_000])]
    start, end = rng.choice(spans[: rng.choice((10, 50, len(spans)))])
    return data[:start] + rng.choice((*_WORDS, data[start:end] * 2, b"-" + data[start:end])) + data[end:]


def _gzip(rng: random.Random, data: bytes) -> bytes:
    """What a gzip file holds, changed and packed again; now and then as a bomb."""
    inner = mutate(rng, zlib.decompressobj(31).decompress(data, 1 << 24))
    return gzip.compress(inner + bytes(3 * 10**7 * (rng.random() < 0.02)), 1, mtime=0)


def _zip(rng: random.Random, data: bytes) -> bytes:
    """The members of a zip archive: their contents, names, number and compression."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    kinds = (zipfile.ZIP_STORED,) * 6 + (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    compression, i = rng.choice(kinds), rng.randrange(len(members))
    name, content = members[i]
    match rng.randrange(12):
        case 0:
            del members[i]
        case 1:
            members += [(f"{k}{name}", content[:200]) for k in range(rng.choice((1, 3000)))]
        case 2:
            members[i] = rng.choice(("x", "../x", "", "\x1b[2J.npy", "meta.json")), content
        case 3:
            members[i], compression = (name, content + bytes(3 * 10**7)), zipfile.ZIP_DEFLATED
        case _:
            members[i] = name, mutate(rng, content)
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return target.getvalue()


def _json(rng: random.Random, data: bytes) -> bytes:
    """A value of a JSON document replaced, removed, repeated, renamed or moved elsewhere."""
    document = json.loads(data)
    places: list[tuple[Any, Any]] = []
    pending = [document]
    while pending and len(places) < 5000:
        here = pending.pop()
        items = list(here.items()) if isinstance(here, dict) else list(enumerate(here))
        places += [(here, key) for key, _ in items]
        pending += [value for _, value in items if isinstance(value, (dict, list))]
    (here, key), (other, other_key) = rng.choice(places), rng.choice(places)
    match rng.randrange(6):
        case 0:
            del here[key]
        case 5 if isinstance(here, dict):
            here[rng.choice([value for value in _VALUES if isinstance(value, str)])] = here.pop(key)
        case 1 if isinstance(here, list):
            here[key:key] = [here[key]] * rng.choice((1, 300))
        case 2:
            here[key] = json.loads(json.dumps(other[other_key]))
        case _:
            here[key] = rng.choice(_VALUES)
    return json.dumps(document).encode()


_INSIDE = {b"\x1f\x8b": _gzip, b"PK": _zip, b"{": _json, b"[": _json}
"""First bytes of files that hold others or have a structure, and how that is changed."""
