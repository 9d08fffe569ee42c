"""Tables of scores in four forms."""

import csv
import io
import json

from gaussian_trimmer.evaluation.tables import (
    FORMATS,
    Change,
    Interval,
    ScoreTable,
    heading,
    known_metrics,
    score_cells,
)

TABLE = ScoreTable(
    "A 50 % test_title",
    ["view", "IoU (%)", "fidelity (dB)", "note"],
    [["a_1.png", Change(90.0, 95.123456), 60.0, "x, y"], ["mean", Change(None, 95.0), None, "R&D"]],
    ["renderer: numba", "mask: alpha > 0.5"],
)


def test_text_is_a_markdown_table_with_title_and_notes():
    lines = TABLE.as_markdown().splitlines()
    rows = [line for line in lines if line.startswith("|")]
    assert lines[0] == "A 50 % test_title" and lines[-2:] == ["renderer: numba", "mask: alpha > 0.5"]
    assert "90.00 -> 95.12" in rows[2] and "- -> 95.00" in rows[3]
    assert len({len(row) for row in rows}) == 1 and set(rows[1]) == {"|", " ", "-", ":"}


def test_csv_has_two_columns_for_a_change_and_notes_as_comments():
    lines = TABLE.as_csv().splitlines()
    assert [line for line in lines if line.startswith("#")] == [
        "# A 50 % test_title",
        "# renderer: numba",
        "# mask: alpha > 0.5",
    ]
    rows = list(csv.DictReader(io.StringIO("\n".join(line for line in lines if not line.startswith("#")))))
    assert rows[0] == {
        "view": "a_1.png",
        "IoU (%) before": "90.0000",
        "IoU (%) after": "95.1235",
        "fidelity (dB)": "60.0000",
        "note": "x, y",
    }
    assert rows[1]["IoU (%) before"] == "" and rows[1]["fidelity (dB)"] == ""


def test_latex_escapes_what_it_would_obey_and_shows_intervals():
    lines = TABLE.as_latex().splitlines()
    assert lines[:3] == ["% A 50 % test_title", "% renderer: numba", "% mask: alpha > 0.5"]
    assert lines[3] == r"\begin{tabular}{lrrr}" and lines[-1] == r"\end{tabular}"
    assert lines[5] == r"view & IoU (\%) & fidelity (dB) & note \\"
    assert lines[7] == r"a\_1.png & $90.00$ $\to$ $95.12$ & $60.00$ & x, y \\"
    assert lines[8] == r"mean & -- $\to$ $95.00$ & -- & R\&D \\"
    rows = [["[~\\^<\n", Interval(-1.0, -2.0, 0.5), Interval(1.0, None, None)]]
    sure = ScoreTable("two\nlines", ["method", "gain", "n"], rows)
    text = FORMATS["latex"](sure)
    assert text.startswith("% two lines\n") and "\n\n" not in text
    head = r"{[}\textasciitilde{}\textbackslash{}\textasciicircum{}$<$"
    assert head + r"  & $-1.00$ $[-2.00, 0.50]$ & $1.00$ \\" in text


def test_json_keeps_before_and_after():
    table = json.loads(FORMATS["json"](TABLE))
    assert table["rows"][0]["IoU (%)"] == {"before": 90.0, "after": 95.1235}
    assert table["notes"] == ["renderer: numba", "mask: alpha > 0.5"]


def test_cells_follow_the_metrics_that_there_are():
    before, after = {"iou": 90.0, "soft_iou": 80.0}, {"iou": 95.0, "fidelity": 50.0, "soft_iou": 85.0}
    metrics = known_metrics(before, after)
    assert metrics == ["iou", "soft_iou", "fidelity"]
    assert score_cells(metrics, before, after) == [Change(90.0, 95.0), Change(80.0, 85.0), 50.0]
    assert score_cells(metrics, None, after) == [95.0, 85.0, 50.0]
    assert heading("iou") == "IoU (%)"
