""".glb with KHR_gaussian_splatting: what it keeps, what the field's converter reads of it, and damaged files."""

from __future__ import annotations

import json
import struct
from typing import Literal

import numpy as np
import pytest
from format_samples import ATTRIBUTES, error, sample, splat_transform

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.glb import AXIS_SIGNS, SH_SIGNS, half_turn

NAME = "KHR_gaussian_splatting"


def test_layout_is_that_of_the_standard(tmp_path):
    gaussians = sample(5, 1)
    formats.write(gaussians, tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    magic, version, total, length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, total, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + length])
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    (primitive,) = document["meshes"][0]["primitives"]
    assert primitive["mode"] == 0
    assert primitive["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse"
    accessor = document["accessors"][primitive["attributes"]["POSITION"]]
    assert np.allclose(accessor["min"], (gaussians.means * [-1, -1, 1]).min(axis=0))
    assert document["accessors"][primitive["attributes"]["KHR_gaussian_splatting:ROTATION"]]["type"] == "VEC4"


@pytest.mark.needs("splat-transform")
def test_the_converter_means_the_same(tmp_path):
    gaussians = sample(60, 3)
    formats.write(gaussians, tmp_path / "a.ply")
    splat_transform(tmp_path / "a.ply", tmp_path / "theirs.glb")
    theirs = formats.read(tmp_path / "theirs.glb")
    order = np.lexsort(theirs.means.T), np.lexsort(gaussians.means.T)
    theirs, ours = theirs.select(order[0]), gaussians.select(order[1])
    for name in ("means", "sh_dc", "sh_rest"):
        assert error(theirs, ours, name) < 1e-4, name
    # Axes may be turned by half a circle, which changes no Gaussian.
    np.testing.assert_allclose(theirs.covariances(), ours.covariances(), rtol=1e-3, atol=1e-6)


def changed(tmp_path, change):
    formats.write(sample(5, 1), tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    document, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    (tmp_path / "b.glb").write_bytes(header + text + rest)
    return tmp_path / "b.glb"


def compressed(document, how, entry):
    extension = document["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]
    extension["extensions"] = {f"KHR_gaussian_splatting_compression_{how}": entry}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(meshes=[]), "no primitive has the extension"),
        (lambda d: d["accessors"][0].update(count=10**9), "damaged"),
        (lambda d: d["accessors"][0].update(bufferView=99), "damaged"),
        (lambda d: d["accessors"][0].update(componentType=[]), "damaged"),
        (lambda d: d["accessors"][0].update(count=2.5), "damaged"),
        (lambda d: d["accessors"][0].update(byteOffset=-4), "damaged"),
        (lambda d: d["bufferViews"][0].update(byteLength=8), "damaged"),
        (lambda d: d["bufferViews"][0].update(byteStride=0), "damaged"),
        (lambda d: d["bufferViews"][0].update(byteOffset=10**11), "damaged"),
        (lambda d: d.update(meshes=7), "damaged"),
        (lambda d: d["accessors"][2].update(count=4), "damaged"),
        (lambda d: d["meshes"][0]["primitives"][0]["attributes"].pop(f"{NAME}:SCALE"), "SCALE is missing"),
        (lambda d: d["meshes"][0]["primitives"][0].pop("attributes"), "damaged"),
        (lambda d: compressed(d, "spz", {"bufferView": 99}), "damaged"),
        (lambda d: compressed(d, "spz", {"bufferView": 0}), "not an .spz file"),
        (lambda d: compressed(d, "lgsc", {"bufferView": 0}), "compressed by KHR_gaussian_splatting_compression_lgsc"),
    ],
)
def test_damaged_files(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        formats.read(changed(tmp_path, change))


def test_normalised_integers_are_read(tmp_path):
    def as_bytes(document):
        place = document["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:OPACITY"]
        document["accessors"][place].update(componentType=5121, normalized=True)

    opacities = formats.read(changed(tmp_path, as_bytes)).opacities
    data = sample(5, 1).opacities.astype("<f4").tobytes()[:5]
    np.testing.assert_allclose(opacities, np.frombuffer(data, np.uint8) / 255, atol=2e-6)


@pytest.mark.parametrize("how", ["spz", "spz_2"])
def test_gaussians_packed_as_spz_are_read(tmp_path, how):
    """What is packed has the axes of the .spz specification, which lie half a turn about x from a PLY's."""
    gaussians = sample(30, 2)
    formats.write(half_turn(gaussians, "x"), tmp_path / "a.spz")
    data = (tmp_path / "a.spz").read_bytes()
    primitive = {"attributes": {"POSITION": 0}, "mode": 0, "extensions": {"KHR_gaussian_splatting": {}}}
    document = {
        "asset": {"version": "2.0"}, "meshes": [{"primitives": [primitive]}], "accessors": [{"count": 30}],
        "buffers": [{"byteLength": len(data)}], "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
    }  # fmt: skip
    compressed(document, how, {"bufferView": 0})
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(data), len(text), b"JSON")
    (tmp_path / "a.glb").write_bytes(header + text + struct.pack("<I4s", len(data), b"BIN\0") + data)
    found, direct = formats.read(tmp_path / "a.glb"), half_turn(formats.read(tmp_path / "a.spz"), "x")
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(found, name), getattr(direct, name))
    assert error(found, gaussians, "means") < 1e-5


@pytest.mark.parametrize("axis", ["x", "z"])
def test_the_turn_keeps_every_view_dependent_colour(axis: Literal["x", "z"]) -> None:
    """Harmonics of a direction, weighted with the signs, are those of the turned direction."""
    directions = np.random.default_rng(0).normal(size=(3, 20))
    turned = _harmonics(*(directions * AXIS_SIGNS[axis][:, None]))
    np.testing.assert_allclose(turned, SH_SIGNS[axis][:, None] * _harmonics(*directions), atol=1e-12)


@pytest.mark.parametrize("axis", ["x", "z"])
def test_the_turn_turns_covariances(axis: Literal["x", "z"]) -> None:
    gaussians = sample(20, 2)
    turned = half_turn(gaussians, axis)
    rotation = np.diag(AXIS_SIGNS[axis])
    np.testing.assert_allclose(
        turned.covariances(), rotation @ gaussians.covariances() @ rotation, rtol=1e-4, atol=1e-7
    )
    np.testing.assert_array_equal(turned.means, gaussians.means @ rotation)
    np.testing.assert_array_equal(half_turn(turned, axis).sh_rest, gaussians.sh_rest)


def _harmonics(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Real harmonics of degrees 1 to 3 in the PLY's order, without their factors, which have no part in the signs."""
    return np.stack(
        [
            y, z, x,
            x * y, y * z, 2 * z * z - x * x - y * y, x * z, x * x - y * y,
            y * (3 * x * x - y * y), x * y * z, y * (4 * z * z - x * x - y * y),
            z * (2 * z * z - 3 * x * x - 3 * y * y),
            x * (4 * z * z - x * x - y * y), z * (x * x - y * y), x * (x * x - 3 * y * y),
        ]
    )  # fmt: skip
