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


def test_means_have_bootstrap_intervals():
    values = np.random.default_rng(1).normal(1.0, 2.0, 400)
    found = interval_of(values)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert found[0] == pytest.approx(values.mean())
    assert (found[2] - found[1]) / 2 == pytest.approx(half, rel=0.05)  # the normal approximation
    assert interval_of([3.0]) == (3.0, None, None)


def run_of(name, before, after, scene="s", views=1):
    return Run(scene, name, "m", "v", views, {"iou": before}, {"iou": after}, 0.0, "")


def test_losing_trims_and_the_worst_are_told():
    runs = [run_of("a", 90.0, 92.0), run_of("b", 80.0, 79.8), run_of("c", 70.0, 69.0)]
    table = table_of_statistics("t", {"M": runs}, ["iou"], ["note"])
    assert table.rows[0][-3:] == [1, -1.0, "s/c"] and table.rows[0][2] == 3
    assert "80.00 [70.00, 90.00] | 80.27 [69.00, 92.00]" in table.text("table")
    assert "$80.00$ [$70.00$, $90.00$] & $80.27$ [$69.00$, $92.00$] & $0.27$ [$-1.00$, $2.00$] & $1$" in table.text(
        "latex"
    )


def test_what_a_mean_is_over_is_what_is_resampled():
    runs = [run_of("a", 90.0, 92.0), run_of("b", 80.0, 80.0, views=3), run_of("c", 70.0, 69.0, "t")]
    by_scene, by_view = (
        table_of_statistics("t", {"M": runs}, ["iou"], [], over).rows[0] for over in ("scenes", "scenes, by view")
    )
    assert by_scene[2] == 2 and by_scene[3] == (77.5, 70.0, 85.0)
    assert by_view[3] == (76.25, 70.0, 82.5)
