"""`python -m tests.fuzz`: see the package."""

from __future__ import annotations

import argparse
import random
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # builders that the tests of the readers have
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from fuzz.mutations import mutate
from fuzz.samples import Files, Reader, check_message, readers
from gaussian_trimmer.errors import InputError

MEMORY = 2 << 30
"""Address space beyond what the process has when it begins."""
SECONDS = 5.0
"""Processor time of a case."""


def make_case(reader: Reader, name: str, seed: int, case: int) -> Files:
    """The files of a case, of which the first is to be read; the first cases are the samples as they are."""
    if case < len(reader.samples):
        return reader.samples[case]
    rng = random.Random(f"{seed}/{name}/{case}")
    files = dict(rng.choice(reader.samples))
    target = rng.choice(list(files))
    files[target] = mutate(rng, files[target])
    return files


def defects(reader: Reader, name: str, seed: int, cases: range) -> Iterator[tuple[int, str]]:
    """Numbers of the cases that neither succeed nor are refused with a sentence, and what was raised instead.

    The samples themselves, which come first, must be read.
    """
    for case in cases:
        print(f"\r{name} {case}", end="", file=sys.stderr, flush=True)
        try:
            with tempfile.TemporaryDirectory() as folder:
                signal.setitimer(signal.ITIMER_PROF, SECONDS)
                _read(
                    reader, make_case(reader, name, seed, case), Path(folder), must_succeed=case < len(reader.samples)
                )
        except Exception:
            yield case, traceback.format_exc()[-1500:]
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)


def _read(reader: Reader, files: Files, folder: Path, *, must_succeed: bool) -> None:
    for file, data in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data)
    try:
        reader.read(folder / next(iter(files)))
    except InputError as error:
        check_message(error)
        assert not must_succeed, error


def limit_this_process() -> None:
    """Limits on memory and on the time of a case, and warnings as errors."""
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    signal.signal(signal.SIGPROF, _stop)
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)


def _stop(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


def main() -> int:
    """Run the cases and list the defects."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Every reader against damaged files.")
    parser.add_argument("--cases", type=int, default=100_000, help="of all readers together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", action="append", choices=list(readers()), help="may be repeated; default: all")
    parser.add_argument("--case", type=int, help="run this case alone")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="save the files of each defect")
    options = parser.parse_args()
    chosen = {name: reader for name, reader in readers().items() if name in (options.reader or readers())}
    cases = range(-(-options.cases // len(chosen))) if options.case is None else [options.case]
    limit_this_process()
    found = 0
    for name, reader in chosen.items():
        for case, said in defects(reader, name, options.seed, cases):
            found += 1
            print(f"\n--seed {options.seed} --reader '{name}' --case {case}\n{said}")
            if options.keep is not None:
                folder = options.keep / f"{name.replace(' ', '-')}-{options.seed}-{case}"
                folder.mkdir(parents=True, exist_ok=True)
                for file, data in make_case(reader, name, options.seed, case).items():
                    (folder / file).parent.mkdir(parents=True, exist_ok=True)
                    (folder / file).write_bytes(data)
    print(f"\n{len(cases) * len(chosen)} cases, {found} defects")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
