"""`make fuzz`: feeds damaged files to the program for some minutes, and prints what came of it."""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz.fuzz import fuzz
from tests.fuzz.seeds import all_kinds
from tests.fuzz.sweep import sweep


def main() -> int:
    """The exit code: 1 after a failure."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=int(time.time()), help="by default another each time")
    parser.add_argument("--sweep", action="store_true", help="instead, each value of each record by each odd one")
    parser.add_argument("--only", default="", help="kinds whose name contains this word")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="folder for what failed")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        kinds = {name: kind for name, kind in all_kinds(Path(folder)).items() if given.only in name}
        seconds = 60 * given.minutes
        result = sweep(kinds, given.out) if given.sweep else fuzz(kinds, given.out, seconds=seconds, seed=given.seed)
    for path, why in result.failures.values():
        print(f"--- {path}\n{why}")
    print(result.table() if given.sweep else f"{result.table()}, seed {given.seed}")
    return bool(result.failures)


if __name__ == "__main__":
    sys.exit(main())
