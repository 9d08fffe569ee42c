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
from gaussian_trimmer.batch.manifest import ELSEWHERE, RowOptions
from gaussian_trimmer.cameras import CameraSet
from gaussian_trimmer.cli import main
from gaussian_trimmer.commands.mark_options import MarkOptions
from gaussian_trimmer.commands.trim import Trim
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.masks.grabcut import GrabCutConfig
from gaussian_trimmer.masks.mask_files import MaskFilesConfig
from gaussian_trimmer.masks.sam import SamConfig
from gaussian_trimmer.options import options_of, parse
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.trimming.config import TrimConfig


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
        ([Item("a.ply", name="x"), Item("b.ply", name="X")], "Items 1 and 2 are both named 'X'"),
        ([Item("a.ply", name="x/y"), Item("b.ply", name="x")], "would lie in that of item 2"),
        ([Item("a.ply", name="../x")], "cannot name a folder on every system, as 'x' can"),
        ([Item("a.ply", name="/x")], "cannot name a folder on every system, as 'x' can"),
        ([Item("a.ply", name="..")], "cannot name a folder on every system, as '_' can"),
        ([Item("a.ply", name="x/.hidden")], "cannot name a folder"),
        ([Item("a.ply", name="x/nul.txt")], "as 'x/_nul.txt' can"),
        (
            [Item("a.ply", "mug.npy", "mug"), Item("a.ply", name="x")],
            "Item 2, 'x', has no selection, while 'mug' has one",
        ),
        ([Item("a.xyz")], "xyz"),
        ([Item("a.ply", format="xyz")], "xyz"),
        ([Item("a.ply", segmenter="sam9")], "sam9"),
        ([Item("a.ply", segmenter_options=GrabCutConfig())], "GrabCutConfig"),
        ([Item("a.ply", config=TrimConfig(context_radius=-1.0))], "context-radius is -1"),
    ],
)
def test_items_that_are_not_possible(items, said):
    with pytest.raises(InputError, match=said):
        check_items(items)


def test_rows_of_a_table(tmp_path):
    path = manifest(tmp_path, 'scene,selection,up,options,name\nrooms/a.ply,rooms/mug.npy,"0,0,1",--views 7,\n'
                              "rooms/c.ply,,-y,,c\n")  # fmt: skip
    first, second = check_items(read_manifest(path, "--plan.size 200"))
    assert first.scene == str(tmp_path / "rooms/a.ply")
    assert first.selection == str(tmp_path / "rooms/mug.npy")
    assert first.name == "rooms/a/mug"
    assert first.config.up == (0.0, 0.0, 1.0)
    assert (first.config.plan.views, first.config.plan.size) == (7, 200)
    assert second.scene == str(tmp_path / "rooms/c.ply")
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
        ("scene,labels\na.ply,b.npy\n", "line 2: It has labels, but no objects; give the ids"),
        ("scene,labels,objects\na.ply,b.npy,\n", "line 2: It has labels, but no objects; give the ids"),
        ("scene,labels,objects\na.ply,b.npy,x y\n", "The objects are 'x y'"),
        ("scene,labels,objects\na.ply,b.npy,3 3\n", "each id once"),
        ("scene,labels,objects,options\na.ply,b.npy,3,--selection.object-id 5\n", "leave --selection.object-id"),
        ("scene,labels,objects\na.ply,b.npy,all\n", "There is no file"),
        ("scene,up\na.ply,w\n", "The up vector is 'w'"),
        ("scene,options\na.ply,--plan.sise 3\n", "line 2: --plan.sise is not an option"),
        ("scene,options\na.ply,--objects 3\n", "line 2: --objects is the column 'objects'"),
        ("scene,options\na.ply,--plan.views x\n", "--plan.views is 'x'"),
        ("scene,options\na.ply,'\n", "cannot be split into words"),
        ("[1]\n", "line 1: It is not a JSON object"),
        ("{\n", "line 1: It is not a JSON object"),
        ("[" * 100000, "line 1: It is not a JSON object"),
        ('{"scene": 3}', "Its scene is a int"),
        ('{"scene": "a.ply", "options": 3}', "Its options are not text"),
        (b"scene\n\xff\xfe\n", "not text in UTF-8"),
    ],
)
def test_manifests_that_are_not_possible(tmp_path, text, said):
    path = tmp_path / ("m.jsonl" if text[0] in "[{" else "m.csv") if isinstance(text, str) else tmp_path / "m.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError, match=said):
        read_manifest(path)


def test_all_rows_that_are_not_possible_are_told_at_once(tmp_path):
    path = manifest(tmp_path, "scene,up,options\na.ply,w,\nb.ply,,\nc.ply,,--plan.sise 3\n" + "d.ply,w,\n" * 20)
    with pytest.raises(InputError, match=r"line 2.*line 4.*line 5.*14 more rows"):
        read_manifest(path)


def test_the_manifest_in_a_folder_is_named(tmp_path):
    manifest(tmp_path, "scene\na.ply\n").rename(tmp_path / "batch.csv")
    with pytest.raises(InputError, match=r"is a folder; give the manifest in it, '.*/batch\.csv'\."):
        read_manifest(tmp_path)


def test_whole_paths_give_short_names(tmp_path):
    data = [f"/data/{room}/scene.ply,/data/{room}/{thing}.npy" for room in ("a", "b") for thing in ("cup", "pot")]
    path = manifest(tmp_path, "\n".join(["scene,selection", *data[:2], "c.ply,d.npy"]))
    assert [item.name for item in check_items(read_manifest(path))] == ["cup", "pot", "c/d"]
    path = manifest(tmp_path, "\n".join(["scene,selection", *data]))
    assert [item.name for item in check_items(read_manifest(path))] == ["a/scene/cup", "a/scene/pot", "b/scene/cup",
                                                                        "b/scene/pot"]  # fmt: skip


@pytest.mark.parametrize("name", ["missing.csv", "known.txt"])
def test_files_that_are_no_manifests(tmp_path, name):
    (tmp_path / "known.txt").write_text("scene\na.ply\n")
    with pytest.raises(InputError, match=name):
        read_manifest(tmp_path / name)


def test_ids_are_those_that_the_file_has_now(tmp_path):
    path = manifest(tmp_path, "scene,labels,objects\na.ply,ids.npy,all\n")
    for ids in ([1, 2], [7, 9]):
        np.save(tmp_path / "ids.npy", np.array([0, *ids]))
        assert [item.name for item in read_manifest(path)] == [f"a/ids-{i}" for i in ids]


@pytest.mark.parametrize(
    "words",
    [
        "--views 3 --background clean",
        "--label-crf.no-enabled --up z", "--label_crf.support_plane.no-enabled --plan.fill=0.5",
        "--preset paper --plan.size 300 --sam.points 2", "--preset paper --segmenter sam --sam.points 2",
        "--selection.object-id 3 4 --format spz", "--for unreal --scale 100 --html",
    ],
)  # fmt: skip
def test_options_are_those_of_trim(words, monkeypatch):
    seen = []
    monkeypatch.setattr(Trim, "run", lambda command: seen.append(command))
    main(["trim", "a.ply", *words.split()])
    (trim,), options = seen, parse(RowOptions, words.split(), "trim")
    assert options.settings() == trim.options.settings()
    assert (options.segmenter, options.used_options()) == (trim.options.segmenter, trim.options.used_options())
    assert (options.selection_options, options.format) == (trim.selection_options, trim.options.format)
    assert (options.placing, options.html) == (trim.results.placing, trim.results.html)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--labels ids.npy", "--labels is the column 'labels'; leave it out."),
        ("--plan.sise 3", "--plan.sise is not an option or argument of 'trim'; did you mean --plan.size?"),
        ("'x", "The options ''x' cannot be split into words (No closing quotation)."),
    ],
)
def test_a_fault_in_the_options_of_all_rows_is_said_once(tmp_path, options, said):
    path = manifest(tmp_path, "scene\n" + "a.ply\n" * 3)
    with pytest.raises(InputError) as refused:
        read_manifest(path, options)
    assert str(refused.value) == f"--options: {said}"


def test_the_page_lists_what_a_batch_has_in_another_way_or_not_at_all():
    """A new option of `trim` is either one of a batch, too, or named there."""
    page = (Path(__file__).parents[1] / "docs" / "batch.md").read_text()
    missing = {option.name for option in options_of(Trim) if not (option.note.positional or option.note.order)}
    missing -= {option.name for option in options_of(RowOptions)}
    marks = {option.name for option in options_of(MarkOptions)}
    assert not [name for name in missing - marks if f"`--{name}`" not in page]
    assert {f"--{name}" for name in missing} == set(ELSEWHERE)


def test_rows_with_options_of_their_own_take_little_work(tmp_path):
    """Counted in calls of functions."""
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
    assert calls / len(items) < 2000, calls / len(items)


def test_fingerprints_tell_contents_and_settings_and_not_names(tmp_path):
    places = {name: tmp_path / name for name in ("a.ply", "b.npy", "other.ply", "c.npy", "masks/0.png", "model.onnx")}
    for place in places.values():
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(b"a")
    options = MaskFilesConfig(tmp_path / "masks")
    item = Item(places["a.ply"], places["b.npy"], segmenter="mask-files", segmenter_options=options)
    sam = replace(item, segmenter="sam", segmenter_options=SamConfig(str(places["model.onnx"])))

    def mark_of(item, cameras=None):
        return fingerprint(item, [Path(item.scene)], cameras)

    mark = mark_of(item)
    same = [replace(item, scene=str(places["other.ply"]), name="x"), replace(item, selection=str(places["c.npy"]))]
    assert {mark_of(other) for other in same} == {mark}
    others = [
        mark_of(replace(item, format="spz")), mark_of(replace(item, background=False)),
        mark_of(replace(item, selection_options=SelectionOptions(object_id=(1,)))),
        mark_of(replace(item, config=TrimConfig(up=(0.0, 0.0, 1.0)))),
        mark_of(item, CameraSet((), None, (), False)), mark_of(sam),
    ]  # fmt: skip
    for name, changed in [("a.ply", item), ("b.npy", item), ("masks/0.png", item), ("model.onnx", sam)]:
        places[name].write_bytes(b"b")
        others.append(mark_of(changed))
        places[name].write_bytes(b"a")
    (tmp_path / "b.json").write_text('{"content": "selection marks"}')
    others.append(mark_of(item))
    assert len({mark, *others}) == len(others) + 1
