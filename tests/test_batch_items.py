"""Items of a batch and the manifests they come from: what they may say, and what is said where they may not."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gaussian_trimmer.batch import Item, read_manifest
from gaussian_trimmer.batch.fingerprints import fingerprint
from gaussian_trimmer.batch.items import check_items
from gaussian_trimmer.batch.options import parse_options
from gaussian_trimmer.cli import main
from gaussian_trimmer.commands.trim import Trim
from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.segmentation.segmenters.grabcut import GrabCutConfig
from gaussian_trimmer.segmentation.segmenters.mask_files import MaskFilesConfig
from gaussian_trimmer.selection_files import SelectionOptions


def manifest(folder, text, ending=".csv"):
    path = folder / f"manifest{ending}"
    path.write_text(text)
    return path


def test_paths_may_be_paths():
    assert Item(Path("a/b.ply"), Path("c.npy")) == Item("a/b.ply", "c.npy")


@pytest.mark.parametrize(
    ("items", "said"),
    [
        ([], "no items"),
        (["a.ply"], "Item 1 is a str"),
        ([Item("a.ply", name="x"), Item("b.ply", name="X")], "Items 1 and 2 are both named 'X'"),
        ([Item("a.ply", name="x/y"), Item("b.ply", name="x")], "would lie in that of item 2"),
        ([Item("a.ply", name="../x")], "cannot be that of a folder"),
        ([Item("a.ply", name="/x")], "cannot be that of a folder"),
        ([Item("a.ply", name="x/.hidden")], "cannot be that of a folder"),
        ([Item("a.xyz")], "no known splat format"),
        ([Item("a.ply", format="xyz")], "Unknown format 'xyz'"),
        ([Item("a.ply", segmenter="sam9")], "Unknown segmenter 'sam9'"),
        ([Item("a.ply", renderer="gspalt")], "Unknown renderer 'gspalt'"),
        ([Item("a.ply", segmenter_options=GrabCutConfig())], "give a SilhouetteConfig"),
        ([Item("a.ply", config=TrimConfig(context_radius=-1.0))], "context-radius is -1"),
    ],
)
def test_items_that_are_not_possible(items, said):
    with pytest.raises(InputError, match=said):
        check_items(items)


def test_rows_of_a_table(tmp_path):
    path = manifest(tmp_path, 'scene,selection,up,options,name\nrooms/a.ply,rooms/mug.npy,"0,0,1",--views 7,\n'
                              "s3://b/c.ply,,-y,,c\n")  # fmt: skip
    first, second = check_items(read_manifest(path, "--plan.size 200"))
    assert first.scene == str(tmp_path / "rooms/a.ply")
    assert first.selection == str(tmp_path / "rooms/mug.npy")
    assert first.name == "rooms/a/mug"
    assert first.config.up == (0.0, 0.0, 1.0)
    assert (first.config.plan.views, first.config.plan.size) == (7, 200)
    assert second.scene == "s3://b/c.ply"
    assert (second.selection, second.name, second.config.up) == (None, "c", (0.0, -1.0, 0.0))


def test_names_do_not_hang_on_where_the_manifest_lies(tmp_path):
    names = []
    for folder in (tmp_path / "a", tmp_path / "b" / "c"):
        folder.mkdir(parents=True)
        names += [item.name for item in read_manifest(manifest(folder, "scene,selection\ns.ply,r.npy\n"))]
    assert names == ["s/r"] * 2


def test_objects_of_labels_are_items(tmp_path):
    np.save(tmp_path / "ids.npy", np.array([0, 0, 7, 7, -1, 3]))
    rows = [
        {"scene": "a.ply", "labels": "ids.npy", "objects": [3, 7]},
        {"scene": "b.ply", "labels": "ids.npy", "objects": "all", "name": "b", "options": ["--views", "3"]},
    ]
    path = manifest(tmp_path, "\n".join(map(json.dumps, rows)) + "\n\n", ".jsonl")
    items = check_items(read_manifest(path))
    assert [item.name for item in items] == ["a/ids-3", "a/ids-7", "b/3", "b/7"]
    assert [item.selection_options for item in items] == [SelectionOptions("labels", (i,)) for i in (3, 7, 3, 7)]


@pytest.mark.parametrize(
    ("text", "ending", "said"),
    [
        ("scene\n", ".csv", "has no rows"),
        ("scene,colour\na.ply,red\n", ".csv", "unknown column 'colour'"),
        ("name\na\n", ".csv", "no column 'scene'"),
        ("scene,selection\na.ply\n", ".csv", "line 2: it has not as many columns"),
        ("scene,selection\na.ply,b,c\n", ".csv", "line 2: it has not as many columns"),
        ('scene\n"a.ply\n', ".csv", "unexpected end of data"),
        ("scene,selection,labels\na.ply,b,c\n", ".csv", "line 2: It has both"),
        ("scene,objects\na.ply,3\n", ".csv", "line 2: It has objects, but no labels"),
        ("scene,labels\na.ply,b.npy\n", ".csv", "line 2: It has labels, but no objects"),
        ("scene,labels,objects\na.ply,b.npy,x y\n", ".csv", "give ids"),
        ("scene,labels,objects\na.ply,b.npy,3 3\n", ".csv", "name an id twice"),
        (
            "scene,labels,objects,options\na.ply,b.npy,3,--selection.object-id 5\n",
            ".csv",
            "leave --selection.object-id",
        ),
        ("scene,labels,objects\na.ply,b.npy,all\n", ".csv", "There is no file"),
        ("scene,up\na.ply,w\n", ".csv", "The up vector is 'w'"),
        ("scene,options\na.ply,--plan.sise 3\n", ".csv", "line 2: The options '--plan.sise 3' are not understood"),
        ("scene,options\na.ply,--plan.views x\n", ".csv", "not understood"),
        ("scene,options\na.ply,'\n", ".csv", "cannot be taken apart"),
        ("[1]\n", ".jsonl", "line 1: it is not a JSON object"),
        ("{\n", ".jsonl", "line 1: it is not a JSON object"),
        ("[" * 100000, ".jsonl", "line 1: it is not a JSON object"),
        ('{"scene": 3}', ".jsonl", "Its scene is a int"),
        ('{"scene": "a.ply", "options": 3}', ".jsonl", "Its options are not text"),
        ("", ".txt", "known endings"),
    ],
)
def test_manifests_that_are_not_possible(tmp_path, text, ending, said):
    with pytest.raises(InputError, match=said):
        read_manifest(manifest(tmp_path, text, ending))


def test_a_manifest_that_is_no_text(tmp_path):
    (tmp_path / "m.csv").write_bytes(b"scene\n\xff\xfe\n")
    with pytest.raises(InputError, match="not text in UTF-8"):
        read_manifest(tmp_path / "m.csv")
    with pytest.raises(InputError, match="There is no manifest"):
        read_manifest(tmp_path / "n.csv")


def test_ids_are_those_that_the_file_has_now(tmp_path):
    path = manifest(tmp_path, "scene,labels,objects\na.ply,ids.npy,all\n")
    for ids in ([1, 2], [7, 9]):
        np.save(tmp_path / "ids.npy", np.array([0, *ids]))
        assert [item.name for item in read_manifest(path)] == [f"a/ids-{i}" for i in ids]


@pytest.mark.parametrize("segmenter", [(), ("--segmenter", "sam")])
def test_the_paper_preset_is_that_of_trim(segmenter, monkeypatch):
    words = ("--preset", "paper", "--plan.size", "300", *segmenter, "--sam.points", "2")
    seen = []
    monkeypatch.setattr(Trim, "run", lambda command: seen.append(command))
    main(["trim", "a.ply", *words])
    (trim,), options = seen, parse_options(words)
    assert options.trim_config() == trim.settings()
    assert (options.segmenter, options.used_options()) == (trim.segmenter, trim.used_options())
    assert options.trim_config().plan.size == 300


@pytest.mark.parametrize(
    ("words", "settings"),
    [
        ("--views 3 --fill", {"plan": {"views": 3}, "fill": True}),
        ("--label-crf.no-enabled", {"label_crf": {"enabled": False}}),
        ("--up 0 0 -1 --plan.fill=0.5", {"up": (0.0, 0.0, -1.0), "plan": {"fill": 0.5}}),
        ("--label_crf.support_plane.no-enabled", {"label_crf": {"support_plane": {"enabled": False}}}),
    ],
)
def test_options_are_those_of_trim(words, settings):
    expected = TrimConfig()
    for name, value in settings.items():
        expected = changed(expected, name, value)
    assert parse_options(tuple(words.split())).trim_config() == expected


def changed(settings, name, value):
    if isinstance(value, dict):
        ((inner, setting),) = value.items()
        value = changed(getattr(settings, name), inner, setting)
    return replace(settings, **{name: value})


def test_rows_with_options_of_their_own_take_little_work(tmp_path):
    """Counted in calls of functions; a parser for all options of `trim` takes some hundred thousand."""
    rows = [f"s.ply,s.npy,i{i},--plan.fill 0.{500 + i}" for i in range(21)]
    first = manifest(tmp_path, "\n".join(["scene,selection,name,options", rows[0]]))
    read_manifest(first)
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        items = read_manifest(manifest(tmp_path, "\n".join(["scene,selection,name,options", *rows[1:]])))
    finally:
        sys.setprofile(None)
    assert [item.config.plan.fill for item in items] == [0.501 + i / 1000 for i in range(20)]
    assert calls / len(items) < 5000, calls / len(items)


def test_fingerprints_tell_contents_and_settings_and_not_names(tmp_path):
    masks = tmp_path / "masks"
    masks.mkdir()
    (masks / "0.png").write_bytes(b"a")
    item = Item("a.ply", "b.npy", segmenter="mask-files", segmenter_options=MaskFilesConfig(masks))
    mark = fingerprint(item, "1", "2", None)
    same = [replace(item, scene="other/a.ply", name="x"), replace(item, selection="c.npy")]
    assert {fingerprint(other, "1", "2", None) for other in same} == {mark}
    others = [
        fingerprint(item, "3", "2", None), fingerprint(item, "1", "3", None), fingerprint(item, "1", "2", "3"),
        fingerprint(replace(item, format="spz"), "1", "2", None),
        fingerprint(replace(item, background=False), "1", "2", None),
        fingerprint(replace(item, selection_options=SelectionOptions(object_id=(1,))), "1", "2", None),
        fingerprint(replace(item, config=TrimConfig(up=(0.0, 0.0, 1.0))), "1", "2", None),
    ]  # fmt: skip
    (masks / "0.png").write_bytes(b"b")
    others.append(fingerprint(item, "1", "2", None))
    assert len({mark, *others}) == len(others) + 1
