"""`python -m tests.fuzz`: see the package."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .harness import OUTCOMES, make_case, run_cases
from .samples import readers


def main() -> int:
    """Run the cases, print a table, and list the defects."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Every reader against hostile files.")
    parser.add_argument("--cases", type=int, default=100_000, help="of all readers together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", action="append", choices=list(readers()), help="may be repeated; default: all")
    parser.add_argument("--case", type=int, help="run this case alone, in this process, and show what happens")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="save the files of each defect")
    options = parser.parse_args()
    chosen = {name: reader for name, reader in readers().items() if name in (options.reader or readers())}
    if options.case is not None:
        return _run_one(chosen, options.seed, options.case, options.keep or Path("out/fuzz"))
    share = -(-options.cases // len(chosen))
    print(f"{'reader':<16}" + "".join(f"{name:>10}" for name in ("cases", *OUTCOMES)) + "   slowest case", flush=True)
    defects = []
    for name, reader in chosen.items():
        tally = run_cases(reader, name, options.seed, range(share), options.keep)
        counts = [share, *(tally.outcomes[outcome] for outcome in OUTCOMES)]
        slowest = f"{tally.slowest[0]:>7} ms ({tally.slowest[1]})"
        print(f"{name:<16}" + "".join(f"{count:>10}" for count in counts) + slowest, flush=True)
        defects += [(name, *defect) for defect in tally.defects]
    for name, case, outcome, said in defects[:100]:
        print(f"\n--seed {options.seed} --reader '{name}' --case {case}: {outcome}\n{said.strip()[-1500:]}")
    print(f"\n{len(defects)} defects")
    return 1 if defects else 0


def _run_one(chosen: dict, seed: int, case: int, keep: Path) -> int:
    """Write the files of a case and read them, without limits."""
    for name, reader in chosen.items():
        files, first = make_case(reader, name, seed, case)
        folder = keep / f"{name.replace(' ', '-')}-{seed}-{case}"
        folder.mkdir(parents=True, exist_ok=True)
        for file, data in files.items():
            (folder / file).write_bytes(data)
        print(f"{folder / first}: {reader.read(folder / first)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
