"""The examples run on their own, and print what they promise."""

import json
import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
SELECTED = 2413


def numbers(line):
    return [float(number.replace(",", "")) for number in re.findall(r"\d[\d,]*(?:\.\d+)?", line)]


def trim_one_object(printed):
    (line,) = printed
    selected, kept = numbers(line)[:2]
    assert selected == SELECTED and 2100 < kept < SELECTED
    picture = Path(line.partition("see ")[2].rstrip("."))
    assert {"object.ply", "background.ply", "before_after.png"} <= {path.name for path in picture.parent.iterdir()}


def lift_masks_and_trim(printed):
    lifted, virtual, given = printed
    assert numbers(lifted)[1:] == [59472, 10]
    assert 2000 < numbers(virtual)[-1] < numbers(lifted)[0]
    assert 2000 < numbers(given)[-1] < numbers(lifted)[0]


def bring_your_own_masks(printed):
    builtin, own = printed
    assert builtin.startswith("silhouettes: 5 masks") and own.startswith("watershed: 5 masks")
    kept = [numbers(line)[1] for line in printed]
    assert all(2000 < n < SELECTED for n in kept) and kept[0] != kept[1]


def measure_a_trim(printed):
    (alone_before, in_scene_before, _), (alone, in_scene, _) = map(numbers, printed)
    assert alone > alone_before + 5 and in_scene > in_scene_before + 1
    assert in_scene > alone + 3  # the fern


def find_objects(printed):
    assert sum("sure, stands" in line and "unsure" not in line for line in printed) == 4
    (tall,) = (line for line in printed if line.startswith("tallest: "))
    assert 2000 < numbers(tall)[0] < SELECTED
    folder = Path(printed[-1].partition(": ")[2])
    assert {"object_tallest.ply", "object_1.ply", "background.ply"} <= {path.name for path in folder.iterdir()}


def click_and_correct(printed):
    clicked, marked, same, trimmed = printed
    assert 2000 < numbers(clicked)[0] < numbers(marked)[0] and same.endswith("True")
    assert numbers(trimmed)[0] > numbers(clicked)[0]


def settings(printed):
    assert printed[0].endswith("filled")
    exact, clean, filled = map(numbers, printed[1:])
    assert exact[0] >= clean[0] and exact[2] == clean[2] == 0 < filled[2]


def files_for_engines(printed):
    assert len(printed) == 3 and all(30 < numbers(line)[-1] < 50 for line in printed)


def arrays_of_a_trainer(printed):
    kept, n = numbers(printed[0])[:2]
    assert 2000 < kept < SELECTED and n == 59472 and printed[0].endswith("trimmed")


def splat_formats(printed):
    lost = {line.partition(": ")[0]: line.partition("at most. ")[2] for line in printed}
    assert lost[".ply"] == lost[".glb"] == "" and "colour" in lost[".splat"] and "precision" in lost[".sog"]


def select_by_marks(printed):
    counts = [numbers(line)[-2] for line in printed]
    assert counts[0] == SELECTED > counts[1] < counts[2]


def several_objects(printed):
    (*_, low, _), (*_, high, _) = map(numbers, printed[:2])
    assert 900 < low < 1300 and 900 < high < 1300 and numbers(printed[2])[-1] == low + high


def size_in_metres(printed):
    assert 0.7 < numbers(printed[0])[1] < 0.8 and printed[1].endswith("0.30 m")


def errors_and_refusals(printed):
    *wrong, refused, trimmed = printed
    assert len(wrong) == 3 and all(line.startswith("cannot: ") for line in wrong)
    assert "scattered" in refused and 2000 < numbers(trimmed)[0] < SELECTED


def which_way_is_up(printed):
    assert [line.partition(" (")[2].partition(",")[0] for line in printed if line.startswith("by")] == [
        "camera file", "ground plane", "ground plane", "given",
    ]  # fmt: skip
    assert sum("is a guess" in line for line in printed) == 1


def what_became_of_each_row(printed):
    counts = {line.partition(":")[0]: numbers(line)[0] for line in printed[:-1]}
    assert counts["kept"] > 55000 and counts["filled"] > 0 and printed[-1].startswith("the same rows: True; ")
    assert numbers(printed[-1])[0] == counts["filled"]


def one_object_after_another(printed):
    first, second, shared = numbers(printed[0])
    assert first > 2000 and second > 1000 and shared == 0


def your_own_report(printed):
    row = json.loads(printed[0])
    assert row["state"] == "done" and row["selected"] == SELECTED and len(printed) == 3


def a_folder_of_scenes(printed):
    assert [line.partition(", ")[0] for line in printed[-2:]] == ["garden: done", "kitchen: done"]


CHECKS = {
    "01_trim_one_object.py": trim_one_object,
    "02_lift_masks_and_trim.py": lift_masks_and_trim,
    "03_bring_your_own_masks.py": bring_your_own_masks,
    "04_select_by_marks.py": select_by_marks,
    "05_measure_a_trim.py": measure_a_trim,
    "07_find_objects.py": find_objects,
    "08_click_and_correct.py": click_and_correct,
    "09_settings.py": settings,
    "10_files_for_engines.py": files_for_engines,
    "11_arrays_of_a_trainer.py": arrays_of_a_trainer,
    "12_splat_formats.py": splat_formats,
    "13_several_objects.py": several_objects,
    "14_size_in_metres.py": size_in_metres,
    "15_errors_and_refusals.py": errors_and_refusals,
    "16_which_way_is_up.py": which_way_is_up,
    "17_what_became_of_each_row.py": what_became_of_each_row,
    "18_one_object_after_another.py": one_object_after_another,
    "19_your_own_report.py": your_own_report,
    "20_a_folder_of_scenes.py": a_folder_of_scenes,
}
"""Example -> what is checked of the lines that it prints."""
QUICK = {
    "01_trim_one_object.py", "04_select_by_marks.py", "05_measure_a_trim.py", "11_arrays_of_a_trainer.py",
    "12_splat_formats.py", "14_size_in_metres.py", "16_which_way_is_up.py",
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CHECKS]
)
def test_an_example_prints_what_it_promises(name, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    CHECKS[name](capsys.readouterr().out.splitlines())


def test_examples_are_many_and_short():
    lengths = {path.name: len(path.read_text().splitlines()) for path in EXAMPLES.glob("[0-9]*")}
    assert len(lengths) >= 20 and all(15 <= length <= 40 for length in lengths.values()), lengths


def test_every_example_is_tested_and_on_the_page_of_its_task():
    pages = "".join(page.read_text() for page in (EXAMPLES.parent / "docs").rglob("*.md"))
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == [*CHECKS]
    assert all(f"examples/{path.name})" in pages for path in EXAMPLES.glob("[0-9]*"))
