""".glb with KHR_gaussian_splatting: what it keeps, what the field's converter reads of it, and damaged files."""

from __future__ import annotations

import base64
import json
import struct
from typing import Literal

import numpy as np
import pytest
from format_samples import ATTRIBUTES, error, sample, splat_transform

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.glb import AXIS_SIGNS, SH_SIGNS, half_turn, write_objects

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


def changed(tmp_path, change, write=lambda path: formats.write(sample(5, 1), path)):
    write(tmp_path / "a.glb")
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


def test_every_splat_is_read_where_its_node_puts_it(tmp_path):
    """Two nodes below a third, of which one has a matrix, in a file of two meshes."""
    first, second = sample(5, 1), sample(7, 2, seed=1)
    parts = [("cup", first, np.array([1.0, 2, 3])), ("saucer", second, np.zeros(3))]
    write_objects(parts, tmp_path / "a.glb")
    plain = formats.read(tmp_path / "a.glb", say=lambda note: None)
    np.testing.assert_allclose(plain.means, np.concatenate([first.means, second.means]), atol=1e-6)
    assert plain.extras["node"].tolist() == [1] * 5 + [2] * 7
    assert "2 splats are read as one" in plain.notes[0]

    quarter, move = np.sqrt(0.5), np.eye(4)
    move[:3, 3], move[:3, :3] = (0, 5, 0), 3 * np.eye(3)

    def nest(document):
        document["nodes"] = [
            {"children": [1, 2], "translation": [10, 0, 0], "rotation": [0, quarter, 0, quarter], "scale": [2, 2, 2]},
            {"mesh": 0},
            {"mesh": 1, "matrix": move.T.ravel().tolist()},
        ]
        document["scenes"][0]["nodes"] = [0]

    found = formats.read(changed(tmp_path, nest, write=lambda path: write_objects(parts, path)), say=lambda note: None)
    turn = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # a quarter about y
    signs = np.array([-1, -1, 1])

    def expected(points, place=0.0, scale=1.0):
        return ((points * signs * scale + place) * 2 @ turn.T + [10, 0, 0]) * signs

    np.testing.assert_allclose(found.means[:5], expected(first.means - [1, 2, 3]), atol=1e-4)
    np.testing.assert_allclose(found.means[5:], expected(second.means, np.array([0, 5, 0]), 3.0), atol=1e-4)
    np.testing.assert_allclose(found.log_scales[5:], second.log_scales + np.log(6), atol=1e-4)
    in_ply = np.diag(signs) @ turn @ np.diag(signs)
    np.testing.assert_allclose(
        found.covariances()[:5], 4 * in_ply @ first.covariances() @ in_ply.T, rtol=1e-3, atol=1e-6
    )


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ({"scale": [1, 2, 1]}, "scales its splat unevenly"),
        ({"scale": [-1, 1, 1]}, "mirrors it"),
        ({"matrix": [float("nan")] * 16}, "unevenly"),
        ({"rotation": [0, 0, 0, 0]}, "unevenly"),
        ({"children": [0]}, "damaged"),
        ({"translation": "far"}, "damaged"),
    ],
)
def test_nodes_that_cannot_be_applied_are_refused(tmp_path, node, message):
    with pytest.raises(InputError, match=message):
        formats.read(changed(tmp_path, lambda document: document["nodes"][0].update(node)))


@pytest.mark.parametrize("inside", [False, True])
def test_a_gltf_reads_its_data_from_beside_it_and_from_nowhere_else(tmp_path, inside):
    gaussians = sample(5, 1)
    formats.write(gaussians, tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    (tmp_path / "a b.bin").write_bytes(binary)
    coded = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    document["buffers"][0]["uri"] = coded if inside else "a%20b.bin"
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    np.testing.assert_array_equal(formats.read(tmp_path / "a.gltf").means, gaussians.means)
    assert [path.name for path in formats.scene_files(tmp_path / "a.gltf")] == ["a.gltf", *["a b.bin"][inside:]]
    document["buffers"][0]["uri"] = "../a b.bin"
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(InputError, match="outside its own folder"):
        formats.read(tmp_path / "below" / "a.gltf")


def test_the_draft_of_2025_is_read(tmp_path):
    def as_draft(document):
        attributes = document["meshes"][0]["primitives"][0]["attributes"]
        for name in ("SCALE", "ROTATION"):
            attributes[f"_{name}"] = attributes.pop(f"{NAME}:{name}")

    gaussians, found = sample(5, 1), formats.read(changed(tmp_path, as_draft))
    np.testing.assert_allclose(found.opacities, gaussians.opacities, atol=1e-5)
    np.testing.assert_allclose(found.log_scales, gaussians.log_scales, atol=1e-5)
