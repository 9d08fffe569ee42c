"""Tables of scores in four forms, and how sure their means are."""

import csv
import io
import json

import numpy as np
import pytest

from gaussian_trimmer.evaluation.tables import (
    ScoreTable,
    interval_of,
    known_metrics,
    score_cells,
    table_of_statistics,
)
from gaussian_trimmer.evaluation.trials import Run

TABLE = ScoreTable(
    "A 50 % test_title",
    ["view", "IoU (%)", "fidelity (dB)", "note"],
    [["a_1.png", (90.0, 95.123456), 60.0, "x, y"], ["mean", (None, 95.0), None, "R&D"]],
    ["renderer: numba", "mask: alpha > 0.5"],
)
FLAT = {"view": "a_1.png", "IoU (%) before": 90.0, "IoU (%) after": 95.1235, "fidelity (dB)": 60.0, "note": "x, y"}


def test_text_is_a_markdown_table_with_title_and_notes():
    lines = TABLE.text("table").splitlines()
    rows = [line for line in lines if line.startswith("|")]
    assert lines[0] == "A 50 % test_title" and lines[-2:] == ["renderer: numba", "mask: alpha > 0.5"]
    assert "90.00 -> 95.12" in rows[2] and "- -> 95.00" in rows[3]
    assert len({len(row) for row in rows}) == 1 and set(rows[1]) == {"|", " ", "-", ":"}


def test_csv_and_json_have_a_column_for_each_number_and_csv_nothing_else():
    first, second = csv.DictReader(io.StringIO(TABLE.text("csv")))
    assert list(first) == list(FLAT)
    assert float(first["IoU (%) after"]) == FLAT["IoU (%) after"] and first["note"] == "x, y"
    assert second["IoU (%) before"] == "" and second["fidelity (dB)"] == ""
    table = json.loads(TABLE.text("json"))
    assert table["rows"][0] == FLAT and table["notes"] == list(TABLE.notes)


def test_latex_escapes_what_it_would_obey_and_shows_intervals():
    lines = TABLE.text("latex").splitlines()
    assert lines[:3] == ["% A 50 % test_title", "% renderer: numba", "% mask: alpha > 0.5"]
    assert lines[3] == r"\begin{tabular}{lrrr}" and lines[-1] == r"\end{tabular}"
    assert lines[5] == r"view & IoU (\%) & fidelity (dB) & note \\"
    assert lines[7] == r"a\_1.png & $90.00$ $\to$ $95.12$ & $60.00$ & x, y \\"
    assert lines[8] == r"mean & -- $\to$ $95.00$ & -- & R\&D \\"
    rows = [["[~\\^<\n", (-1.0, -2.0, 0.5), (1.0, None, None)]]
    text = ScoreTable("two\nlines", ["method", "gain", "n"], rows).text("latex")
    assert text.startswith("% two lines\n") and "\n\n" not in text
    head = r"{[}\textasciitilde{}\textbackslash{}\textasciicircum{}$<$"
    assert head + r"  & $-1.00$ [$-2.00$, $0.50$] & $1.00$ \\" in text


def test_cells_follow_the_metrics_that_there_are():
    before, after = {"iou": 90.0, "soft_iou": 80.0}, {"iou": 95.0, "fidelity": 50.0, "soft_iou": 85.0}
    metrics = known_metrics(before, after)
    assert metrics == ["iou", "soft_iou", "fidelity"]
    assert score_cells(metrics, before, after) == [(90.0, 95.0), (80.0, 85.0), 50.0]
    assert score_cells(metrics, None, after) == [95.0, 85.0, 50.0]


def test_an_interval_is_students_and_none_is_made_of_fewer_than_five():
    assert interval_of([1.0, 2.0, 3.0, 4.0, 5.0]) == pytest.approx(
        (3.0, 3 - 2.776445 * 0.5**0.5, 3 + 2.776445 * 0.5**0.5)
    )
    assert interval_of([1.0, 2.0, 3.0, 4.0]) == (2.5, None, None)
    assert interval_of(range(8), list("aabbccdd")) == (3.5, None, None)


def test_intervals_cover_the_mean_of_captures_whose_objects_err_alike():
    random, captures = np.random.default_rng(1), np.repeat(list("abcdef"), 6)
    values = random.normal(size=(500, 6)).repeat(6, axis=1) + random.normal(size=(500, 36))
    covered, as_if_alone = (
        np.mean([low < 0 < high for _, low, high in (interval_of(row, units) for row in values)])
        for units in (captures, None)
    )
    assert 0.92 < covered < 0.98 and as_if_alone < 0.75


def run_of(name, before, after, scene="s", views=1):
    return Run(scene, name, "m", "v", views, {"iou": before}, {"iou": after}, 0.0, "")


def test_losing_trims_and_the_worst_are_told():
    gains = {"a": 2.0, "b": -0.2, "c": -1.0, "d": 0.0, "e": 0.5}
    runs = [run_of(name, 90.0, 90.0 + gain, scene=name) for name, gain in gains.items()]
    table = table_of_statistics("t", {"M": runs}, ["iou"], ["note"])
    assert table.rows[0][2:4] == [5, 5] and table.rows[0][-3:] == [1, -1.0, "c/c"]
    assert "| 90.26 [88.88, 91.64] | 0.26 [-1.12, 1.64] |" in table.text("table")
    assert "$90.26$ [$88.88$, $91.64$] & $0.26$ [$-1.12$, $1.64$] & $1$" in table.text("latex")
    of_one = table_of_statistics("t", {"M": runs}, ["iou"], [], capture_of=lambda scene: "x" if scene < "c" else scene)
    assert of_one.rows[0][3:5] == [4, (90.0, None, None)]


def test_means_are_over_the_units_of_the_data_set():
    runs = [run_of("a", 90.0, 92.0), run_of("b", 80.0, 80.0, views=3), run_of("c", 70.0, 69.0, "t")]
    by_scene, by_view = (
        table_of_statistics("t", {"M": runs}, ["iou"], [], over).rows[0] for over in ("scenes", "scenes, by view")
    )
    assert by_scene[2:5] == [2, 2, (77.5, None, None)] and by_view[4] == (76.25, None, None)
