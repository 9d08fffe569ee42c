"""Ways to change a file so that it becomes a stranger's: bytes, fields, structures, and what containers hold."""

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
_NUMBERS = (0, 1, 2, 3, 7, 8, 16, 40, 45, 127, 128, 255, 256, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**63)
_FLOATS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-45, 1e-30, -1e-30, 1e19, 1e20, 1e30, -1e30, 3.4e38, 50.0, 88.0, 89.0, 200.0, -200.0,
    float("nan"), float("inf"), float("-inf"),
)  # fmt: skip
_WORDS = (
    b"", b"0", b"-1", b"1", b"40", b"41", b"nan", b"inf", b"-inf", b"1e30", b"1e308", b"1e400", b"1e-320", b"-0",
    b"99999999999999999999", b"2147483648", b"1" * 5000, b"0x10", b"1_0", b"\xd9\xa3", b"true", b"null", b"[]", b"{}",
    b"(", b")", b"'", b'"', b"\x1b]0;owned\x07\x1b[2J", b"\xff\xfe", b"\x00", b"x" * 300, b"../../etc/passwd", b"\\",
    "ä\u202e\ud800".encode("utf-8", "surrogatepass"), b",", b"\r\n", b"#", b"[" * 2000, b"-" * 3000 + b"1",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 40, 256, 65536, 10**9, 2**31, 2**63, 2**64, 10**30, 10**400, 0.5, 1e-30, 1e19, 1e30,
    1e308, -1e308, float("nan"), float("inf"), "", "1", "nan", "\x1b[2J\x07", "x" * 300, "x" * 20_000,
    "../../etc/passwd", "/etc/passwd", "a\x00b", "\ud800", [], {}, [[]], [1], [[1, 2], [3]], {"a": 1}, [0.0] * 256,
    [None] * 256, [1e308] * 3,
)  # fmt: skip


def mutate(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
    """The data changed in one to four ways; `others` are files of which pieces may be taken."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        data = _mutate_once(rng, data, others)
    return data


def _mutate_once(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
    ways = [_bytes, _bytes, _fields]
    for begins, way in _STRUCTURES:
        if data.startswith(begins):
            ways = [way] * 5 + [_body, _body] + ways
            break
    else:
        if _is_text(data):
            ways = [_tokens, _lines, _tokens, _lines, *ways]
    if rng.random() < 0.05:
        ways = [lambda r, d: _splice(r, d, others)]
    try:
        changed = rng.choice(ways)(rng, data)
    except Exception:  # what is changed already may not have its structure any more
        changed = _bytes(rng, data)
    return changed if len(changed) <= LARGEST_FILE else changed[:LARGEST_FILE]


def _is_text(data: bytes) -> bool:
    return all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in data[:200])


def _at(rng: random.Random, data: bytes, size: int = 1) -> int:
    """A place in the data, in the first bytes more often than later."""
    end = max(1, len(data) - size + 1)
    return rng.randrange(min(end, rng.choice((16, 64, 256, 4096 + 1024, end, end))))


def _bytes(rng: random.Random, data: bytes) -> bytes:
    """Single bytes and runs of them changed, cut out, doubled or cut off."""
    changed = bytearray(data)
    match rng.randrange(8):
        case 0:
            for _ in range(rng.choice((1, 1, 2, 8, 64))):
                if changed:
                    changed[_at(rng, changed)] ^= 1 << rng.randrange(8)
        case 1:
            for _ in range(rng.choice((1, 1, 2, 8, 64))):
                if changed:
                    changed[_at(rng, changed)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
        case 2:
            return data[: rng.randrange(len(data) + 1)]
        case 3:
            at = _at(rng, data)
            del changed[at : at + rng.choice((1, 2, 4, 8, 16, 100, 1000))]
        case 4:
            at, size = _at(rng, data), rng.choice((1, 2, 4, 8, 16, 100, 1000))
            changed[at:at] = data[at : at + size] * rng.choice((1, 1, 2, 10))
        case 5:
            at = _at(rng, data)
            changed[at:at] = rng.randbytes(rng.choice((1, 2, 4, 8, 100)))
        case 6:
            at, size = _at(rng, data), rng.choice((1, 4, 16, 100, 1000))
            changed[at : at + size] = bytes([rng.choice((0, 255, rng.randrange(256)))]) * len(changed[at : at + size])
        case 7:
            a, b, size = _at(rng, data), _at(rng, data), rng.choice((1, 4, 8, 16, 64))
            changed[a : a + size], changed[b : b + size] = data[b : b + size], data[a : a + size]
    return bytes(changed)


def _body(rng: random.Random, data: bytes) -> bytes:
    """What lies behind the headers."""
    at = rng.randrange(len(data) // 4, len(data)) if len(data) > 4 else 0
    return data[:at] + _fields(rng, data[at : at + 4096]) + data[at + 4096 :]


def _fields(rng: random.Random, data: bytes) -> bytes:
    """A number in binary overwritten by one that is rarely met."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5))):
        kind = rng.choice("bBhHiIqQefd")
        if kind in "efd":
            number: Any = rng.choice(_FLOATS)
            layout = ("<" if rng.random() < 0.8 else ">") + ("f" if kind == "e" and abs(number) > 6e4 else kind)
        else:
            number, layout = rng.choice(_NUMBERS) + rng.choice((0, 0, 0, 1, -1)), "<" + kind
            bits = 8 * struct.calcsize(layout)
            number &= 2**bits - 1
            if kind.islower() and number >= 2 ** (bits - 1):
                number -= 2**bits
        size = struct.calcsize(layout)
        at = _at(rng, data, size)
        if rng.random() < 0.7:
            at -= at % min(size, 4)
        if at + size <= len(changed):
            struct.pack_into(layout, changed, at, number)
    return bytes(changed)


def _splice(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
    """The beginning of one file and the end of another, or some of another in the middle."""
    other = rng.choice(others)
    a, b = _at(rng, data), _at(rng, other)
    if rng.random() < 0.5:
        return data[:a] + other[b:]
    return data[:a] + other[b : b + rng.choice((4, 16, 100, 1000))] + data[a:]


def _tokens(rng: random.Random, data: bytes) -> bytes:
    """A word of a text replaced, doubled or removed."""
    spans = [match.span() for match in re.finditer(rb"[^\s,:\[\]{}()]+", data[:200_000])]
    if not spans:
        return _bytes(rng, data)
    start, end = rng.choice(spans[: rng.choice((10, 50, len(spans)))])
    word = rng.choice((*_WORDS, data[start:end] * 2, data[start:end] + b"0", b"-" + data[start:end]))
    return data[:start] + word + data[end:]


def _lines(rng: random.Random, data: bytes) -> bytes:
    """A line of a text removed, doubled, moved, or repeated many times."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[i]
        case 1:
            lines[i:i] = [lines[i]]
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i:i] = [lines[i]] * rng.choice((10, 1000, 1_000_000 // max(1, len(lines[i]))))
        case 4:
            lines[i] = lines[i].rstrip(b"\r\n") + rng.choice((b"", b"\r\n", b" ", b"\x00\n"))
    return b"".join(lines)


def _ply(rng: random.Random, data: bytes) -> bytes:
    """A line or a word of the header of a PLY."""
    end = data.find(b"end_header")
    if end < 0:
        return _bytes(rng, data)
    head, body = data[:end], data[end:]
    match rng.randrange(4):
        case 0 | 1:
            return _tokens(rng, head) + body
        case 2:
            return _lines(rng, head) + body
        case _:
            types = (b"char", b"uchar", b"short", b"int", b"uint", b"float", b"double", b"list uchar int")
            words = (b"vertex", b"chunk", b"sh", b"x", b"opacity", b"rot_0", b"scale_2", b"f_rest_0", b"mask")
            extra = rng.choice((
                b"property " + rng.choice(types) + b" " + rng.choice(words) + b"\n",
                b"element " + rng.choice(words) + b" " + str(rng.choice(_NUMBERS)).encode() + b"\n",
                b"format " + rng.choice((b"ascii", b"binary_little_endian", b"binary_big_endian")) + b" 1.0\n",
                b"property float " + rng.choice(_WORDS) + b"\n",
            ))  # fmt: skip
            lines = head.splitlines(keepends=True)
            lines.insert(rng.randrange(len(lines) + 1), extra * rng.choice((1, 1, 1, 2, 300)))
            return b"".join(lines) + body


def _gzip(rng: random.Random, data: bytes) -> bytes:
    """What a gzip file holds, changed and packed again; now and then as a bomb."""
    inner = zlib.decompressobj(31).decompress(data, 1 << 24)
    if rng.random() < 0.02:
        inner = _fields(rng, inner[:16]) + inner[16:] + bytes(rng.choice((10**6, 3 * 10**7)))
    packed = gzip.compress(_mutate_once(rng, inner, [inner]), rng.choice((1, 6)), mtime=0)
    return packed + (rng.randbytes(rng.choice((10, 3_000_000))) if rng.random() < 0.02 else b"")


def _zip(rng: random.Random, data: bytes) -> bytes:
    """The members of a zip archive: their contents, names, number and compression."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist() if info.file_size < 1 << 24]
    compression = rng.choice(
        (zipfile.ZIP_STORED,) * 6 + (zipfile.ZIP_DEFLATED,) * 3 + (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    )
    i = rng.randrange(len(members))
    name, content = members[i]
    chance = rng.random()
    if chance < 0.75:
        members[i] = name, _mutate_once(rng, content, [content for _, content in members])
    elif chance < 0.8:
        del members[i]
    elif chance < 0.85:
        members.append((name, content))
    elif chance < 0.9:
        members[i] = rng.choice(("x", "../x", "", "\x1b[2J.npy", "meta.json", "a" * 300 + ".npy", "ä.npy")), content
    elif chance < 0.93:
        members[i] = name, rng.choice(members)[1]
    elif chance < 0.96:
        members[i], compression = (name, content + bytes(rng.choice((10**6, 3 * 10**7)))), zipfile.ZIP_DEFLATED
    else:
        members += [(f"{k}{name}", content[:200]) for k in range(rng.choice((10, 3000)))]
        compression = zipfile.ZIP_STORED
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", compression) as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    packed = target.getvalue()
    if rng.random() < 0.15:  # in the headers and the list at the end
        at = packed.rfind(rng.choice((b"PK\1\2", b"PK\3\4", b"PK\5\6")))
        if at >= 0:
            packed = packed[:at] + _fields(rng, packed[at : at + 46]) + packed[at + 46 :]
    return packed


def _json(rng: random.Random, data: bytes) -> bytes:
    """A value of a JSON document replaced, removed, renamed or repeated."""
    document = json.loads(data)
    places: list[tuple[Any, Any]] = []
    pending = [document]
    while pending and len(places) < 5000:
        here = pending.pop()
        items = list(here.items()) if isinstance(here, dict) else list(enumerate(here))
        places += [(here, key) for key, _ in items]
        pending += [value for _, value in items if isinstance(value, (dict, list))]
    if not places:
        return json.dumps(rng.choice(_VALUES)).encode()
    here, key = rng.choice(places[: rng.choice((5, 30, len(places)))])
    match rng.randrange(7):
        case 0 | 1 | 2:
            here[key] = rng.choice(_VALUES)
        case 3:
            del here[key]
        case 4 if isinstance(here, list):
            size = max(1, len(json.dumps(here[key])))
            here[key:key] = [here[key]] * rng.choice((1, 3, 300, min(100_000, 2_000_000 // size)))
        case 4 | 5 if isinstance(here, dict):
            here[rng.choice((*here, "w", "h", "up", "version", "count", "\x1b[2J", "x" * 1000))] = here[key]
        case _:
            other, other_key = rng.choice(places)
            here[key] = json.loads(json.dumps(other[other_key]))
    return json.dumps(document).encode()


def _npy(rng: random.Random, data: bytes) -> bytes:
    """The header of an .npy file, whose length is then put right."""
    (length,) = struct.unpack_from("<H", data, 8)
    header, body = data[10 : 10 + length], data[10 + length :]
    match rng.randrange(4):
        case 0:
            header = _tokens(rng, header)
        case 1:
            kinds = (
                b"|b1",
                b"<f2",
                b"<f8",
                b">i8",
                b"<u8",
                b"|O",
                b"<U5",
                b"<c16",
                b"<M8[s]",
                b"|V8",
                b"<f16",
                b"x",
                b"<i3",
            )
            header = re.sub(rb"'descr': '[^']*'", lambda _: b"'descr': '" + rng.choice(kinds) + b"'", header)
        case 2:
            shapes = (
                b"()", b"(0,)", b"(40,)", b"(40, 1)", b"(1, 40)", b"(4, 10)", b"(10, 4)", b"(-1,)", b"(True,)", b"(40",
                b"(99999999999999999999,)", b"(0, 999999999999999, 999999999999999)", b"(40L,)", b"40", b"[40]",
                b"(" + b"1," * 40 + b")", b"(1000000000,)", b"(" * 900 + b"40" + b")" * 900,
                b"(" + b"-" * 3000 + b"1,)",
            )  # fmt: skip
            shape = rng.choice(shapes)
            header = re.sub(rb"'shape': \([^)]*\)", lambda _: b"'shape': " + shape, header)
        case 3:
            header = _bytes(rng, header)
    header = header[:65000]
    return data[:8] + struct.pack("<H", len(header)) + header + body


def _png(rng: random.Random, data: bytes) -> bytes:
    """The chunks of a PNG, with their checksums put right; now and then a picture that is as large as it says."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        size = struct.unpack_from(">I", data, at)[0]
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    i = rng.randrange(len(chunks))
    name, content = chunks[i]
    match rng.randrange(6):
        case 0:
            width, height, depth, colours = struct.unpack_from(">IIBB", chunks[0][1])
            change = rng.randrange(4)
            sizes = (0, 1, 2, 8, 24, 1000, 65535, 60000, 2**31 - 1)
            width = rng.choice(sizes) if change == 0 else width
            height = rng.choice(sizes) if change == 1 else height
            depth, colours = (
                (rng.choice((1, 2, 4, 8, 16)), rng.choice((0, 2, 3, 4, 6))) if change > 1 else (depth, colours)
            )
            chunks[0] = b"IHDR", struct.pack(">IIBB", width, height, depth, colours) + chunks[0][1][10:]
            if rng.random() < 0.3:
                chunks[1:] = [(b"IDAT", zlib.compress(bytes(rng.choice((10, 10**5, 3 * 10**7))))), (b"IEND", b"")]
        case 1:
            chunks[i] = name, _bytes(rng, content)
        case 2:
            chunks[i:i] = [chunks[i]] * rng.choice((1, 5, 1000))
        case 3:
            del chunks[i]
        case 4:
            names = (b"PLTE", b"tRNS", b"iCCP", b"zTXt", b"iTXt", b"acTL", b"fcTL", b"fdAT", b"eXIf", b"gAMA", b"sBIT")
            extra = rng.choice((b"", content, b"x\0\0" + zlib.compress(bytes(10**7)), rng.randbytes(40)))
            chunks.insert(rng.randrange(1, len(chunks) + 1), (rng.choice(names), extra))
        case 5:
            inner = zlib.decompressobj().decompress(content, 1 << 22) if name == b"IDAT" else content
            chunks[i] = name, zlib.compress(_bytes(rng, inner)) if name == b"IDAT" else _fields(rng, inner)
    packed = data[:8]
    for name, content in chunks:
        packed += struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
    return packed


def _pickle(rng: random.Random, data: bytes) -> bytes:
    """The instructions of a torch file's structure."""
    at = rng.randrange(2, len(data) + 1) if len(data) > 2 else 0
    snippets = (
        b"}", b"]", b")", b"(", b"t", b"R", b"b", b"s", b"u", b"e", b"a", b"Q", b"N", b".", b"0", b"2", b"1", b"\x86",
        b"cos\nsystem\n", b"cbuiltins\neval\n", b"ctorch\nfloat8_e4m3fn\n", b"ctorch._utils\n_rebuild_qtensor\n",
        b"X\4\0\0\0evil", b"\x8a\xff" + b"\xff" * 255, b"h\0", b"q\0", b"J\xff\xff\xff\x7f", b"J\xff\xff\xff\xff",
        b"\x8a\x08" + b"\xff" * 7 + b"\x7f", b"G\x7f\xf8\0\0\0\0\0\0", b"(" * 100 + b"t" * 100,
        b"]" * 5000, b"]a" * 5000,
        b"q\1h\1h\1\x86" * 60, b"}q\1h\1h\1\x86h\1s",
    )  # fmt: skip
    names = (
        b"FloatStorage",
        b"BoolStorage",
        b"LongStorage",
        b"BFloat16Storage",
        b"ComplexFloatStorage",
        b"UntypedStorage",
    )
    match rng.randrange(4):
        case 0:
            return data[:at] + rng.choice(snippets) + data[at:]
        case 1:
            return re.sub(rb"[A-Za-z0-9]+Storage", lambda _: rng.choice(names), data, count=rng.choice((1, 1, 0)))
        case 2:
            numbers = [match.start() for match in re.finditer(rb"[JK]", data)]
            where = rng.choice(numbers) + 1
            return (
                data[:where] + struct.pack("<i", rng.choice((0, 1, -1, 16, 40, 2**20, 2**31 - 1))) + data[where + 4 :]
            )
        case _:
            return _bytes(rng, data)


def _riff(rng: random.Random, data: bytes) -> bytes:
    """The size that a WebP announces."""
    changed = bytearray(data)
    at = rng.choice((12, 21, 22, 23, 24, 26, 28))
    changed[at : at + 4] = rng.choice((b"VP8L", b"VP8X", b"VP8 ", rng.randbytes(4), b"\xff\xff\xff\x0f", bytes(4)))
    return bytes(changed)


_STRUCTURES = (
    (b"ply", _ply),
    (b"\x1f\x8b", _gzip),
    (b"PK", _zip),
    (b"{", _json),
    (b"[", _json),
    (b"\x93NUMPY", _npy),
    (b"\x89PNG", _png),
    (b"\x80\x02", _pickle),
    (b"RIFF", _riff),
)
