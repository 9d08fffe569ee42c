"""Lower bounds of what the program runs with, against the holes that are known."""

import datetime
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CHECK = runpy.run_path(str(ROOT / ".ci" / "check_bounds.py"))
TODAY = CHECK["LOOKED_AT"]


def test_no_bound_has_a_known_hole():
    assert not list(CHECK["faults"](ROOT / "pyproject.toml", TODAY))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("filelock>=3.20.3", "filelock>=3.20", "filelock>=3.20 follows links"),
        ("rich>=13.0", "poor>=13.0", "poor is not in known_holes.csv"),
        ("pillow>=10.3", "pillow>=11", ""),
    ],
)
def test_a_bound_that_is_too_low_and_a_new_package_are_named(tmp_path, old, new, said):
    text = (ROOT / "pyproject.toml").read_text()
    (tmp_path / "pyproject.toml").write_text(text.replace(f'"{old}"', f'"{new}"'))
    found = list(CHECK["faults"](tmp_path / "pyproject.toml", TODAY))
    assert [sentence.startswith(said) for sentence in found] == [True] * bool(said)


def test_an_old_list_is_named():
    (sentence,) = CHECK["faults"](ROOT / "pyproject.toml", TODAY + datetime.timedelta(days=CHECK["MOST_DAYS"] + 1))
    assert "do so again" in sentence
