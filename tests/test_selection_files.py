from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from selection_builders import make_scene, rows_mask

from gaussian_trimmer.commands import parser_of
from gaussian_trimmer.commands.arguments import selection_options_of
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.selection_files import KINDS, SelectionOptions, load_selection

N = 12
SCENE = make_scene(N)


def save(path: Path, array) -> Path:
    np.save(path, np.asarray(array))
    return path


def select(path: Path, **options) -> list[int]:
    selection = load_selection(path, SCENE, SelectionOptions(**options))
    assert selection.shape == (N,)
    assert selection.dtype == np.bool_
    return np.flatnonzero(selection).tolist()


@pytest.mark.parametrize(
    "values",
    [
        rows_mask(N, 2, 5),
        rows_mask(N, 2, 5)[:, None],
        rows_mask(N, 2, 5)[None],
        rows_mask(N, 2, 5).astype(np.int64),
        rows_mask(N, 2, 5).astype(np.uint8) * 255,
        rows_mask(N, 2, 5).astype(np.float32),
    ],
    ids=["bool", "column", "row", "0/1", "0/255", "float"],
)
def test_mask_of_every_type(tmp_path, values):
    assert select(save(tmp_path / "m.npy", values)) == [2, 5]


def test_mask_in_npz_alone_or_by_name(tmp_path):
    np.savez_compressed(tmp_path / "one.npz", anything=rows_mask(N, 3))
    np.savez(tmp_path / "named.npz", mask=rows_mask(N, 4), scores=np.ones(N), note=np.array("text"))
    assert select(tmp_path / "one.npz") == [3]
    assert select(tmp_path / "named.npz") == [4]
    assert select(tmp_path / "named.npz", property="scores", threshold=0.5) == list(range(N))


def test_mask_of_wrong_length_names_both_lengths(tmp_path):
    for values in (np.ones(7, bool), np.array([0, 1, 0, 1, 1, 0, 0]), np.linspace(0, 1, 7)):
        with pytest.raises(InputError, match=r"7 entries, but the scene has 12 Gaussians"):
            select(save(tmp_path / "m.npy", values))


def test_scores_need_a_threshold(tmp_path):
    path = save(tmp_path / "scores.npy", np.linspace(-1, 1, N))
    with pytest.raises(InputError, match=r"scores from -1 to 1; choose with --set selection\.threshold"):
        select(path)
    assert select(path, threshold=0.75) == [10, 11]


def test_labels_need_an_id_and_list_what_there_is(tmp_path):
    path = save(tmp_path / "labels.npy", [0, 0, 3, 3, 3, -1, 0, 0, 0, 0, 7, 0])
    with pytest.raises(InputError, match=r"selection\.object-id=VALUE, .*: -1 \(1\), 0 \(7\), 3 \(3\), 7 \(1\)\."):
        select(path)
    with pytest.raises(InputError, match=r"no Gaussians of object 4; its ids \(Gaussians\): -1 \(1\)"):
        select(path, object_id=(3, 4))
    assert select(path, object_id=(3,)) == [2, 3, 4]
    assert select(path, object_id=(7, -1)) == [5, 10]


def test_an_id_turns_a_two_valued_array_into_labels(tmp_path):
    path = save(tmp_path / "labels.npy", rows_mask(N, 0, 1).astype(int))
    assert select(path) == [0, 1]
    assert select(path, object_id=(0,)) == list(range(2, N))


@pytest.mark.parametrize("rows", [np.uint32([11, 0]), [0, 1], [1]])
def test_integers_of_another_length_are_row_numbers(tmp_path, rows):
    assert select(save(tmp_path / "rows.npy", rows)) == sorted(rows)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([3, 4, 3], "3 integers, some of them equal, for a scene of 12"),
        ([3, 12], "lists row 12, but .* 0 to 11"),
        ([3, -1], "lists row -1"),
    ],
)
def test_impossible_row_numbers(tmp_path, rows, message):
    with pytest.raises(InputError, match=message):
        select(save(tmp_path / "rows.npy", rows))


def test_ambiguous_archive_names_the_kinds_and_can_be_forced(tmp_path):
    path = tmp_path / "both.npz"
    np.savez(path, mask=rows_mask(N, 1), labels=np.arange(N) % 3)
    with pytest.raises(InputError, match=r"as mask or as labels; say which with --set selection\.kind=mask"):
        select(path)
    assert select(path, kind="mask") == [1]
    assert select(path, kind="labels", object_id=(2,)) == [2, 5, 8, 11]


def test_options_without_use_are_refused(tmp_path):
    path = save(tmp_path / "m.npy", rows_mask(N, 2))
    with pytest.raises(InputError, match=r"which does not use --set selection\.gamma=VALUE, --set selection\.object"):
        select(path, object_id=(1,), gamma=0.5)


def test_nothing_selected_is_said(tmp_path):
    with pytest.raises(InputError, match="selects none of the 12 Gaussians"):
        select(save(tmp_path / "m.npy", np.zeros(N, bool)))


@pytest.mark.parametrize("kind", ["auto", *sorted(KINDS)])
def test_arrays_of_no_use_are_no_selection_of_any_kind(tmp_path, kind):
    np.savez(tmp_path / "x.npz", a=np.zeros((3, 4), np.float32), b=np.zeros(2))
    said = r"a: float32 \(3, 4\); b: float64 \(2,\)\), which does not select from 12" if kind == "auto" else None
    with pytest.raises(InputError, match=said):
        select(tmp_path / "x.npz", kind=kind)


def test_arrays_that_have_to_be_named_are_said(tmp_path):
    np.savez(tmp_path / "x.npz", exact=rows_mask(N, 2), wobbly=rows_mask(N, 3))
    for given in ({}, {"property": "woble"}):
        with pytest.raises(InputError, match=r"; name an array, such as --set selection\.property=exact\."):
            select(tmp_path / "x.npz", **given)


def test_unknown_names(tmp_path):
    with pytest.raises(InputError, match=r"selection\.kind is 'maks'; available: auto, mask"):
        select(save(tmp_path / "m.npy", rows_mask(N, 2)), kind="maks")
    with pytest.raises(InputError, match="There is no file"):
        select(tmp_path / "absent.npy")
    (tmp_path / "mask.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"known endings: \.npy, .*\.ply"):
        select(tmp_path / "mask.png")


def test_pickled_objects_are_not_loaded(tmp_path):
    objects = np.array([{"a": 1}] * N)
    np.save(tmp_path / "m.npy", objects, allow_pickle=True)
    np.savez(tmp_path / "m.npz", mask=objects)
    np.savez(tmp_path / "both.npz", mask=rows_mask(N, 2), names=objects)
    with pytest.raises(InputError, match="not a NumPy array of numbers"):
        select(tmp_path / "m.npy")
    with pytest.raises(InputError, match="no array of numbers"):
        select(tmp_path / "m.npz")
    assert select(tmp_path / "both.npz") == [2]


def test_damaged_arrays(tmp_path):
    with pytest.raises(InputError, match="type <U3"):
        select(save(tmp_path / "s.npy", ["abc"] * N))
    path = save(tmp_path / "m.npy", rows_mask(N, 2))
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(InputError, match="damaged"):
        select(path)


def documented_commands() -> list[str]:
    text = (Path(__file__).parents[1] / "docs" / "methods.md").read_text("utf-8")
    return re.findall(r"gaussian-trimmer trim ([^`\n]+)", text)


def test_documented_commands_are_understood():
    commands = documented_commands()
    assert len(commands) > 5
    for command in commands:
        options = selection_options_of(parser_of("trim").parse(command.split()))
        given, kind = options.given(), options.kind
        assert kind == "auto" or given <= set(KINDS[kind][1]), command


LISTS = {
    "3\n5\n": [3, 5],
    "index\n3\n5\n": [3, 5],
    "3.0, 5.00": [3, 5],
    "3;5;3": [3, 5],
    '"row"\r\n3\r\n5\r\n': [3, 5],
    "# picked\n3 5 # two": [3, 5],
    "rows of the mug\n3\n5\n": [3, 5],
    "1 two": "not a list of whole numbers",
    "index,x,y\n5,1,2\n7,3,4\n": "a table of 3 columns",  # the others must not be taken for row numbers
    "1 " * 20 + "2 " * 15: "some of them equal",
    "\udcff": "its text is damaged",
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("text", LISTS)
def test_lists_as_people_write_them(tmp_path, text, encoding):
    """The shell of Windows writes UTF-16."""
    path, expected = tmp_path / "rows.csv", LISTS[text]
    path.write_bytes(text.encode(encoding, "surrogatepass" if encoding == "utf-16" else "surrogateescape"))
    if isinstance(expected, list):
        assert select(path) == expected
        return
    with pytest.raises(InputError, match=expected):
        select(path)


@pytest.mark.parametrize(
    ("text", "rows"),
    [("[3, 5, 5]", [3, 5]), ('{"indices": [5.0, 3]}', [3, 5]), (str([i == 4 for i in range(N)]).lower(), [4])],
)
def test_lists_in_json(tmp_path, text, rows):
    (tmp_path / "rows.json").write_text(text)
    assert select(tmp_path / "rows.json") == rows


@pytest.mark.parametrize("text", ["[3, 5.5]", "[[3], [5]]", '{"a": [1], "b": [2]}', "[3, null]", "3", "[3,", "[1e999]"])
def test_json_that_is_no_list(tmp_path, text):
    (tmp_path / "rows.json").write_text(text)
    with pytest.raises(InputError, match=r"rows\.json"):
        select(tmp_path / "rows.json")


def test_labels_of_a_trim_select_its_objects(tmp_path):
    arrays = {"source_index": [7, 2, 2, 0, 1, 3], "object_ids": [4, 9], "object_rows": [1, 2], "n_scene": N}
    path = tmp_path / "labels.npz"
    np.savez(path, **arrays)
    assert select(path, object_id=(4,)) == [7]
    assert select(path, object_id=(4, 9)) == [2, 7]
    np.savez(tmp_path / "one.npz", **{**arrays, "object_ids": [1], "object_rows": [3]})
    assert select(tmp_path / "one.npz") == [2, 7]
    for changed, message in (
        ({}, r"ids \(Gaussians\): 4 \(1\), 9 \(2\)"),
        ({"source_index": [7, 2, 40, 0, 1, 3]}, "made for another scene"),
        ({"n_scene": N + 1}, "made for another scene"),
        ({"object_rows": [1, -3]}, "is damaged"),
        ({"object_rows": [1, 6]}, "is damaged"),
        ({"object_ids": [1.5, 2]}, "is damaged"),
    ):
        np.savez(path, **{**arrays, **changed})
        with pytest.raises(InputError, match=message):
            select(path)


def test_of_many_ids_a_message_lists_the_objects_with_most_gaussians(tmp_path):
    path = save(tmp_path / "ids.npy", np.repeat(np.arange(12), [50, *range(1, 12)]))
    said = r"of object 99; its ids \(Gaussians\): 11 \(11\), 10 \(10\),.* 4 \(4\) and 3 more"
    with pytest.raises(InputError, match=said):
        load_selection(path, make_scene(116), SelectionOptions("labels", (99,)))
