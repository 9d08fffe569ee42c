"""Compare the lower bounds of all that the program runs with, as pyproject.toml has them, with a list of known holes.

`known_holes.csv` is kept by hand, since advisory databases cannot be asked from everywhere. Each package is in it, with
empty cells if it has no known hole; a hole is either fixed in the lowest version that may be installed, or the list has
a reason why it may stay. Run by .ci/nightly: python .ci/check_bounds.py [PYPROJECT]
"""

import csv
import datetime
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

LOOKED_AT = datetime.date(2026, 11, 28)
"""When the list was last looked through by hand."""
MOST_DAYS = 120
NOT_RUN = ("docs", "test", "dev")
"""Extras for those who work on the project, whose tools read only its own files."""


def faults(project: Path, today: datetime.date) -> Iterator[str]:
    """Yield what is wrong with the bounds or the list, a sentence each."""
    facts = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
    extras = facts["optional-dependencies"]
    texts = [*facts["dependencies"], *(text for name in extras if name not in NOT_RUN for text in extras[name])]
    with (Path(__file__).parent / "known_holes.csv").open(newline="", encoding="utf-8") as file:
        holes = list(csv.DictReader(file))
    if (today - LOOKED_AT).days > MOST_DAYS:
        yield f"known_holes.csv was looked through on {LOOKED_AT}; do so again, and change the date."
    for needed in sorted({(one.name.lower(), str(one.specifier)) for one in map(Requirement, texts)}):
        name, bounds = needed
        lowest = max(Version(one.version) for one in Requirement(f"{name}{bounds}").specifier if one.operator == ">=")
        known = [hole for hole in holes if hole["package"] == name]
        if not known:
            yield f"{name} is not in known_holes.csv; look for its holes, and add it."
        for hole in known:
            if hole["hole"] and not hole["why_it_may_stay"] and lowest < Version(hole["fixed_in"]):
                yield f"{name}>={lowest} {hole['hole']}; ask for {hole['fixed_in']} or newer."


if __name__ == "__main__":
    found = list(faults(Path(*sys.argv[1:2] or ["pyproject.toml"]), datetime.date.today()))
    print("\n".join(found) or f"No lower bound has a known hole (list of {LOOKED_AT}).")
    sys.exit(bool(found))
