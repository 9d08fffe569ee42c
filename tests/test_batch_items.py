"""Manifests of batches: what they may say, and what is said where they may not."""

import numpy as np
import pytest

from gaussian_trimmer.commands import batch as command
from gaussian_trimmer.commands import parser_of
from gaussian_trimmer.commands.manifest import Item, check_names, read_manifest
from gaussian_trimmer.errors import InputError


@pytest.fixture(autouse=True)
def _any_file(monkeypatch):
    """Scenes and selections are there, whatever they are called."""
    monkeypatch.setattr(command, "_stamp", lambda path: [1, 1, 1])


def manifest(folder, text, name="manifest.csv"):
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder / name


def items_of(path, options=""):
    return command.items_of(parser_of("batch").parse([str(path), "--options", options]))


@pytest.mark.parametrize(
    ("names", "said"),
    [(["x", "X"], "Two items are named 'X'"), (["x/y", "x"], "item 'x/y' would lie in that of 'x'")],
)
def test_names_that_are_in_each_others_way(names, said):
    with pytest.raises(InputError, match=said):
        check_names([Item(name) for name in names])


def test_rows_of_a_table(tmp_path):
    path = manifest(tmp_path, 'scene,selection,up,options,name,cameras\na.ply,mug.npy,"0,0,1",--views 7,,sparse/0\n'
                              "rooms/c.ply,,-y,,c,\n")  # fmt: skip
    first, second = items_of(path, "--set plan.size=200")
    assert first.name == "a-mug" and " ".join(first.words) == (
        f"{tmp_path}/a.ply {tmp_path}/mug.npy --cameras {tmp_path}/sparse/0 --up 0 0 1 --views 7 --set plan.size=200"
    )
    assert second.name == "c" and " ".join(second.words) == f"{tmp_path}/rooms/c.ply --up 0 -1 0 --set plan.size=200"
    assert [one.name for one in items_of(path, "--format spz")] == ["a-mug", "c"]


def test_objects_of_labels_are_items_with_the_ids_that_the_file_has_now(tmp_path):
    path = manifest(tmp_path, "scene,labels,objects,name\na.ply,ids.npy,3 7,\nb.ply,ids.npy,all,b\n")
    for ids in ([7, 3], [9, 12]):
        np.save(tmp_path / "ids.npy", np.array([0, 0, -1, *ids]))
        items = items_of(path)
        assert [item.name for item in items] == ["a-ids-3", "a-ids-7", *(f"b/{number}" for number in sorted(ids))]
        assert items[0].words[2:] == ("--set", "selection.kind=labels", "--set", "selection.object-id=3")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scene\n", "no rows"),
        ("scene,colour\na.ply,red\n", "line 1: 'colour'"),
        ("name\na\n", "line 1: The column 'scene'"),
        ("scene,selection\na.ply\n", "line 2: It does not have as many columns"),
        ("scene,selection\na.ply,b,c\n", "line 2: It does not have as many columns"),
        ('scene\n"a.ply\n', "unexpected end of data"),
        ("scene,selection,labels\na.ply,b,c\n", "line 2: It has both"),
        ("scene,objects\na.ply,3\n", "line 2: It has objects, but no labels"),
        ("scene;selection;cameras\na.ply;b.npy;c\n", r"'scene;selection;cameras' is not .* separated by commas\."),
        ("scene,labels,objects\na.ply,b.npy,\n", "line 2: It has labels, but no objects; give the ids"),
        ("scene,labels,objects\na.ply,b.npy,x y\n", "The objects are 'x y'"),
        ("scene,labels,objects\na.ply,b.npy,3 3\n", "each id once"),
        ("scene,labels,objects\na.ply,b.npy,all\n", "There is no file"),
        ("scene,up\na.ply,w\n", "--up is 'w'"),
        ("scene,name\na.ply,../x\n", "cannot name a folder on every system, as 'x' can"),
        ("scene,name\na.ply,/x\n", "cannot name a folder on every system, as 'x' can"),
        ("scene,name\na.ply,..\n", "cannot name a folder on every system, as '_' can"),
        ("scene,name\na.ply,x/.hidden\n", "cannot name a folder"),
        ("scene,name\na.ply,x/nul.txt\n", "as 'x/_nul.txt' can"),
        ("scene\na.xyz\n", "xyz"),
        ("scene,options\na.ply,--format xyz\n", "xyz"),
        ("scene,options\na.ply,--set context-radius=-1\n", "context-radius is -1"),
        ("scene,options\na.ply,--set plan.sise=3\n", "line 2: --set plan.sise: there is no such"),
        ("scene,options\na.ply,--objects 3\n", "line 2: --objects is the column 'objects'; leave it out"),
        ("scene,options\na.ply,--no-quiet\n", "line 2: --no-quiet is an option of the batch itself"),
        ("scene,options\na.ply,'\n", "cannot be split into words"),
        (b"scene\n\xff\xfe\n", "not text in UTF-8"),
        ("scene,selection,name\na.ply,mug.npy,mug\na.ply,,x\n", "a row without a selection beside others"),
    ],
)
def test_manifests_that_are_not_possible(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        items_of(manifest(tmp_path, text))


def test_all_rows_that_are_not_possible_are_told_at_once(tmp_path):
    path = manifest(tmp_path, "scene,up,options\na.ply,w,\nb.ply,,\nc.ply,,--set plan.sise=3\n" + "d.ply,w,\n" * 20)
    with pytest.raises(InputError, match=r"line 2.*line 4.*line 5.*14 more rows"):
        items_of(path)


def test_the_manifest_in_a_folder_is_named(tmp_path):
    manifest(tmp_path, "scene\na.ply\n", "batch.csv")
    with pytest.raises(InputError, match=r"is a folder; give the manifest in it, '.*/batch\.csv'\."):
        items_of(tmp_path)


@pytest.mark.parametrize("name", ["missing.csv", "known.jsonl"])
def test_files_that_are_no_manifests(tmp_path, name):
    manifest(tmp_path, "scene\na.ply\n", "known.jsonl")
    with pytest.raises(InputError, match=name):
        read_manifest(tmp_path / name, Item)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--labels ids.npy", "--labels is the column 'labels'; leave it out."),
        ("--set plan.sise=3", "--set plan.sise: there is no such setting; did you mean plan.size?"),
        ("'x", "The options ''x' cannot be split into words (No closing quotation)."),
    ],
)
def test_a_fault_in_the_options_of_all_rows_is_said_once(tmp_path, options, said):
    path = manifest(tmp_path, "scene\n" + "a.ply\n" * 3)
    with pytest.raises(InputError) as refused:
        items_of(path, options)
    assert str(refused.value) == f"--options: {said}"
