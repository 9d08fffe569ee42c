"""Files of torch.save, read without torch: what lies where, and what is refused before anything is made of it."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fuzz.torch_archives import Raw, named, storage, tensor, torch_file
from selection_builders import make_scene, rows_mask

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats.checkpoints import parse_checkpoint
from gaussian_trimmer.formats.torch_files import as_array, load
from gaussian_trimmer.selection_files import SelectionOptions, load_selection

N = 12
SCENE = make_scene(N)
MASK = rows_mask(N, 1, 8)


def save(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def array_of(path: Path, value: object, **storages: bytes) -> np.ndarray:
    file = load(save(path, torch_file(value, storages=storages)))
    return as_array(file, file.value)


@pytest.mark.parametrize("kind", ["f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "b1"])
def test_numbers_of_every_type(tmp_path, kind):
    values = (np.arange(6).reshape(2, 3) % 2).astype(kind)
    found = array_of(tmp_path / "a.pt", values)
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


def test_bfloat16_becomes_float32(tmp_path):
    values = np.float32([1.5, -2.0, 0.25])
    halves = (values.view(np.uint32) >> 16).astype("<u2").tobytes()
    found = array_of(tmp_path / "a.pt", tensor(storage("BFloat16Storage", "x", 3), 0, (3,), (1,)), x=halves)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, values)


def test_views_are_read_where_they_lie(tmp_path):
    numbers = storage("LongStorage", "x", 12)
    data = np.arange(12).astype("<i8").tobytes()
    np.testing.assert_array_equal(
        array_of(tmp_path / "a.pt", tensor(numbers, 1, (2, 3), (1, 4)), x=data), [[1, 5, 9], [2, 6, 10]]
    )
    np.testing.assert_array_equal(array_of(tmp_path / "a.pt", tensor(numbers, 11, (1,), (10**9,)), x=data), [11])
    np.testing.assert_array_equal(
        array_of(tmp_path / "a.pt", tensor(numbers, 3, (2, 2), (0, 0)), x=data), np.full((2, 2), 3)
    )
    assert array_of(tmp_path / "a.pt", tensor(numbers, 0, (0, 7), (7, 1)), x=data).size == 0


def test_big_endian_files(tmp_path):
    source = io.BytesIO(torch_file(np.array([1, 2, 3], ">i4").view("<i4")))
    target = io.BytesIO()
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for info in old.infolist():
            new.writestr(info.filename, b"big" if info.filename.endswith("byteorder") else old.read(info))
    file = load(save(tmp_path / "a.pt", target.getvalue()))
    assert as_array(file, file.value).tolist() == [1, 2, 3]


def test_a_mask_and_a_checkpoint_without_torch(tmp_path):
    assert np.array_equal(load_selection(save(tmp_path / "mask.pt", torch_file(MASK[:, None])), SCENE), MASK)
    rest = np.ascontiguousarray(SCENE.sh_rest.transpose(0, 2, 1))
    parts = [
        SCENE.means,
        SCENE.sh_dc[:, None],
        rest,
        SCENE.log_scales,
        SCENE.quaternions,
        SCENE.opacity_logits[:, None],
    ]
    logits = np.where(MASK, 5, -5).astype(np.float32)
    state = {"state": {0: {"step": np.zeros(1)}}, "param_groups": [{"lr": 0.1, "betas": (0.9, 0.999), "params": [0]}]}
    path = save(tmp_path / "chkpnt.pth", torch_file(((3, *parts, logits, None, None, None, state, 4.7), 30_000)))
    assert np.array_equal(load_selection(path, SCENE), MASK)
    assert parse_checkpoint(load(path)).iteration == 30_000
    np.testing.assert_array_equal(formats.read(path).sh_rest, SCENE.sh_rest)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (tensor(storage("FloatStorage", "x", 4), 0, (5,), (1,)), "is not whole"),
        (tensor(storage("FloatStorage", "x", 4), 3, (2,), (1,)), "is not whole"),
        (tensor(storage("FloatStorage", "x", 4), 0, (2, 2), (2**60, 1)), "is not whole"),
        (tensor(storage("FloatStorage", "y", 4), 0, (4,), (1,)), "is not whole"),
        (tensor(storage("FloatStorage", "x", 4), 0, (-1,), (1,)), "impossible shape"),
        (tensor(storage("FloatStorage", "x", 4), 0, (4,), (-1,)), "impossible shape"),
        (tensor(storage("FloatStorage", "x", 4), 0, (2**62,) * 300, (0,) * 300), "impossible shape"),
        (tensor(storage("FloatStorage", "x", 4), 2**80, (1,), (1,)), "more than 64 bits"),
        (tensor(storage("FloatStorage", "x", 4), 2**63, (1,), (1,)), "impossible shape"),
        (tensor(storage("FloatStorage", "x", 4), 0, (2**62,), (0,)), "expanded tensors"),
        (tensor(storage("ComplexFloatStorage", "x", 2), 0, (2,), (1,)), "type ComplexFloatStorage"),
        (Raw(named("torch._utils", "_rebuild_sparse_tensor") + b")R"), "sparse"),
        (Raw(named("torch", "device") + b"X\3\0\0\0cpu\x85R"), "holds a device that is not a selection"),
        ((np.zeros(3), Raw(named("os", "system") + b"X\2\0\0\0ls\x85R")), r"names os\.system.*can run code"),
        (Raw(named("builtins", "eval")), "can run code"),
        (Raw(named("numpy", "dtype") + b"X\2\0\0\0O8\x89\x88\x87R"), "holds a dtype that is not a selection"),
        (Raw(b"Nr\xff\xff\xff\x7f"), "a place in memory"),
        (Raw(b"})" + b"\x85" * 200_000 + b"K\1s"), "a tuple as a key"),
        (Raw(b"}()" + b"\x85" * 200_000 + b"K\1u"), "a tuple as a key"),
        (Raw(b"()" + b"\x85" * 200_000 + b"K\1d"), "a tuple as a key"),
        (Raw(b"})" + b"q\0h\0\x86" * 90 + b"K\1s"), "a tuple as a key"),
        (Raw(b"}" + named("torch._utils", "_rebuild_parameter") + b")\x85\x85RK\1s"), "holds a dict that is not"),
        (Raw(b"\x8f()" + b"\x85" * 200_000 + b"\x90"), "a set"),
        (Raw(b"()" + b"\x85" * 200_000 + b"\x91"), "a set"),
        (Raw(b"}\x8b" + struct.pack("<i", 200_000) + b"\x7f" * 200_000 + b"K\1s"), "a number of more than 64 bits"),
        (Raw(b"h\7"), "damaged"),
        (Raw(b"R"), "damaged"),
        (Raw(b"}K\1K\1e"), "damaged"),
        ("text", "holds a str that is not a selection"),
    ],
)
def test_what_is_refused(tmp_path, value, message):
    path = save(tmp_path / "a.pt", torch_file(value, storages={"x": bytes(16)}))
    with pytest.raises(InputError, match=message):
        load_selection(path, SCENE)


def test_what_a_file_does_to_what_it_names_has_no_effect(tmp_path):
    mask = tensor(storage("ByteStorage", "x", N), 0, (N,), (1,))
    state = named("collections", "OrderedDict") + b")R(X\4\0\0\0mask" + mask + b"u}X\5\0\0\0items(K\1lsb"
    data = torch_file(Raw(state), storages={"x": MASK.tobytes()})
    assert np.array_equal(load_selection(save(tmp_path / "a.pt", data), SCENE), MASK)
    changed = Raw(named("torch", "device") + b"}X\4\0\0\0nameX\1\0\0\0zsb")
    assert load(save(tmp_path / "a.pt", torch_file({"a": changed}))).value["a"].name == "device"


def test_many_names_for_the_same_numbers_are_refused_before_they_are_read(tmp_path):
    same = tensor(storage("BFloat16Storage", "x", 100_000), 0, (100_000,), (1,))
    path = save(tmp_path / "a.pt", torch_file({f"a{i}": same for i in range(500)}, storages={"x": bytes(200_000)}))
    tracemalloc.start()
    with pytest.raises(InputError, match="share their numbers"):
        load_selection(path, SCENE)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5e6  # read, they would take 200 MB


def test_tied_tensors_are_read(tmp_path):
    same = tensor(storage("ByteStorage", "x", N), 0, (N,), (1,))
    path = save(tmp_path / "a.pt", torch_file({"mask": same, "again": same}, storages={"x": MASK.tobytes()}))
    assert np.array_equal(load_selection(path, SCENE, SelectionOptions(property="mask")), MASK)


def test_structures_beyond_all_need_are_not_parsed(tmp_path):
    path = save(tmp_path / "a.pt", torch_file(Raw(b"]" * (1 << 20))))
    with pytest.raises(InputError, match="more than the 1048576 that it can need"):
        load_selection(path, SCENE)


def test_an_archive_without_a_structure(tmp_path):
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("archive/data/0", b"")
    with pytest.raises(InputError, match=r"0 members 'data\.pkl'"):
        load_selection(save(tmp_path / "a.pt", target.getvalue()), SCENE)
