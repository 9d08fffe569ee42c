"""The standard PLY: exact round trips, what other writers make of it, and damaged files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from format_samples import ATTRIBUTES, sample

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import ply
from gaussian_trimmer.gaussians import Gaussians

NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
NAMES += [*[f"scale_{i}" for i in range(3)], *[f"rot_{i}" for i in range(4)]]


def write_raw(
    path: Path, rows: np.ndarray, names: list[str], encoding: str = "binary_little_endian", kind: str = "float"
) -> None:
    """A PLY of other writers: any names, any order, any type."""
    header = f"ply\nformat {encoding} 1.0\ncomment made by hand\nelement vertex {len(rows)}\n"
    header += "".join(f"property {kind} {name}\n" for name in names) + "end_header\n"
    code = {"float": "f4", "double": "f8"}[kind]
    if encoding == "ascii":
        data = "\n".join(" ".join(repr(float(value)) for value in row) for row in rows).encode()
    else:
        data = rows.astype((">" if "big" in encoding else "<") + code).tobytes()
    path.write_bytes(header.encode() + data)


def raw_rows(n: int = 5) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(n, len(NAMES))).astype(np.float32)


def test_layout_is_inrias(tmp_path: Path) -> None:
    gaussians = sample(2, 1)
    ply.write(gaussians, tmp_path / "a.ply")
    header, data = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
    names = [line.split()[-1] for line in header.decode().splitlines() if line.startswith("property float")]
    assert names[:9] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    assert names[9:18] == [f"f_rest_{i}" for i in range(9)]
    assert names[18:] == ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    row = np.frombuffer(data, "<f4").reshape(2, -1)[1]
    np.testing.assert_array_equal(row[9:18], gaussians.sh_rest[1].ravel())  # red's three, green's three, blue's three
    np.testing.assert_array_equal(row[3:6], 0)


def test_arrays_are_views_of_one_table_but_the_centres(tmp_path: Path) -> None:
    ply.write(sample(10), tmp_path / "a.ply")
    gaussians = ply.read(tmp_path / "a.ply")
    for name in ATTRIBUTES:
        assert getattr(gaussians, name).flags.owndata == (name == "means")
        assert not getattr(gaussians, name).flags.writeable
    assert gaussians.means.flags.c_contiguous


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["float", "double"])
def test_encodings_types_and_orders_agree(tmp_path: Path, encoding: str, kind: str) -> None:
    rows = raw_rows()
    order = np.random.default_rng(1).permutation(len(NAMES))
    write_raw(tmp_path / "plain.ply", rows, NAMES)
    write_raw(tmp_path / "other.ply", rows[:, order], [NAMES[i] for i in order], encoding, kind)
    expected, gaussians = ply.read(tmp_path / "plain.ply"), ply.read(tmp_path / "other.ply")
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(gaussians, name), getattr(expected, name))
        assert getattr(gaussians, name).dtype == np.float32


def test_extras_are_kept_and_written_on_demand(tmp_path: Path) -> None:
    extras = {"mask": np.arange(4, dtype=np.uint8), "score": np.linspace(0, 1, 4, dtype=np.float32)}
    gaussians = sample(4, 1).replace(extras=extras)
    ply.write(gaussians, tmp_path / "with.ply", extras=True)
    ply.write(gaussians, tmp_path / "without.ply")
    again = ply.read(tmp_path / "with.ply")
    np.testing.assert_array_equal(again.extras["mask"], extras["mask"])
    np.testing.assert_array_equal(again.extras["score"], extras["score"])
    np.testing.assert_array_equal(again.sh_rest, gaussians.sh_rest)
    assert ply.read(tmp_path / "without.ply").extras == {}


@pytest.mark.parametrize("extras", [{"id": np.arange(4)}, {"two words": np.zeros(4, np.float32)}])
def test_extras_that_a_ply_cannot_hold_are_refused(tmp_path: Path, extras: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match="A PLY cannot hold"):
        ply.write(sample(4).replace(extras=extras), tmp_path / "a.ply", extras=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_elements_before_and_after_the_vertices_are_passed_over(tmp_path: Path, encoding: str) -> None:
    rows = raw_rows(3)
    write_raw(tmp_path / "a.ply", rows, NAMES, encoding)
    header, data = (tmp_path / "a.ply").read_bytes().split(b"element vertex 3\n")
    properties, data = data.split(b"end_header\n")
    camera = b"element camera 2\nproperty float f\n"
    before = b"1.5\n2.5\n" if encoding == "ascii" else np.array([1.5, 2.5], "<f4").tobytes()
    whole = header + camera + b"element vertex 3\n" + properties + b"element end 1\nproperty char e\nend_header\n"
    (tmp_path / "b.ply").write_bytes(whole + before + data + b"\n1")
    np.testing.assert_array_equal(ply.read(tmp_path / "b.ply").means, rows[:, :3])


def test_windows_line_ends_in_the_header(tmp_path: Path) -> None:
    rows = raw_rows(2)
    write_raw(tmp_path / "a.ply", rows, NAMES)
    header, data = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
    (tmp_path / "a.ply").write_bytes((header + b"end_header\n").replace(b"\n", b"\r\n") + data)
    np.testing.assert_array_equal(ply.read(tmp_path / "a.ply").means, rows[:, :3])


def test_infinities_of_converters_become_finite(tmp_path: Path) -> None:
    rows = raw_rows(3)
    rows[0, 6], rows[1, 6], rows[2, 8] = np.inf, -np.inf, -np.inf
    write_raw(tmp_path / "a.ply", rows, NAMES)
    gaussians = ply.read(tmp_path / "a.ply")
    assert np.isfinite(gaussians.opacity_logits).all()
    assert gaussians.opacities[0] > 0.999
    assert gaussians.opacities[1] < 0.001
    assert 0 < gaussians.scales[2, 1] < 1e-9
    np.testing.assert_array_equal(gaussians.means, rows[:, :3])


@pytest.mark.parametrize(
    ("name", "value"),
    [*((name, np.nan) for name in ATTRIBUTES), *((name, np.inf) for name in ATTRIBUTES if name != "opacity_logits")],
)
def test_values_of_which_none_is_finite_are_refused(tmp_path: Path, name: str, value: float) -> None:
    gaussians = sample(90, 1)
    ply.write(gaussians.replace(**{name: np.full_like(getattr(gaussians, name), value)}), tmp_path / "a.ply")
    with pytest.raises(InputError, match=f"have {name} that cannot be used, the first in row 0"):
        formats.read(tmp_path / "a.ply")


def test_normals_and_extras_may_be_anything(tmp_path: Path) -> None:
    rows = np.column_stack([raw_rows(3), np.full((3, 2), np.nan)])
    write_raw(tmp_path / "a.ply", rows, [*NAMES, "nx", "label"])
    assert len(ply.read(tmp_path / "a.ply")) == 3


HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n"
ASCII = HEADER.replace("binary_little_endian", "ascii")
PROPERTIES = "".join(f"property float {name}\n" for name in NAMES)
POSITIONS = "".join(f"property float {name}\n" for name in "xyz")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "does not begin with 'ply'"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 3\n", "without an end"),
        (b"ply\nformat binary_little_endian 1.0\n" + b"comment c\n" * 120_000, "without an end"),
        (b"ply\nend_header\n", "without a format or without elements"),
        (HEADER.format(count=2, properties="property quad x\n").encode(), "cannot be understood"),
        (HEADER.format(count=0, properties=PROPERTIES).encode(), "zero Gaussians"),
        (HEADER.format(count=10**15, properties=PROPERTIES).encode() + bytes(56), "truncated"),
        (HEADER.format(count=2, properties=PROPERTIES).encode() + bytes(100), "truncated"),
        (HEADER.format(count=1, properties="property float x\n").encode() + bytes(4), "lack y, z, f_dc_0"),
        (HEADER.format(count=1, properties=POSITIONS).encode() + bytes(12), "rot_3. It holds a point cloud or a mesh"),
        (HEADER.format(count=1, properties=PROPERTIES + "property float x\n").encode() + bytes(60), "twice"),
        (HEADER.format(count=1, properties=PROPERTIES + "element vertex 1\n").encode(), "two elements"),
        (HEADER.format(count=1, properties=PROPERTIES + "property float f_rest_0\n").encode() + bytes(60), "f_rest"),
        (HEADER.format(count=1, properties="property list uchar int v\n").encode() + bytes(9), "list properties"),
        (HEADER.replace("vertex", "face").format(count=1, properties=PROPERTIES).encode(), "no vertex element"),
        (ASCII.format(count=10**12, properties=PROPERTIES).encode(), "short"),
        (ASCII.replace("element", f"element e {10**30}\nproperty char c\nelement", 1)
         .format(count=1, properties=PROPERTIES).encode() + b"1 " * 14, "short"),
        (ASCII.format(count=1, properties=PROPERTIES).encode(), "0 rows"),
        (ASCII.format(count=1, properties=PROPERTIES).encode() + b"1 2 3" * 9, "damaged"),
        (ASCII.format(count=1, properties=PROPERTIES).encode() + b"1e99 " * 14, "means that cannot be used"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        formats.read(path)


def test_a_selection_is_written_as_read(tmp_path: Path) -> None:
    ply.write(sample(300, 2), tmp_path / "a.ply")
    gaussians: Gaussians = ply.read(tmp_path / "a.ply")
    rows = np.array([5, 3, 299])
    ply.write(gaussians.select(rows), tmp_path / "a.ply")  # the file itself is replaced
    np.testing.assert_array_equal(ply.read(tmp_path / "a.ply").sh_rest, gaussians.sh_rest[rows])
    before = gaussians.sh_rest.copy()
    os.truncate(tmp_path / "a.ply", 0)  # a mapping of the file would end the process below
    np.testing.assert_array_equal(gaussians.sh_rest, before)
