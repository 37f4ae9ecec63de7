"""`python -m tools.answers`: see the package."""

import argparse
import sys
import tempfile
from pathlib import Path

import tools.answers
from tools.answers.comparing import compare
from tools.answers.inputs import ROOT
from tools.answers.running import compare_times, keep


def main(words: list[str] | None = None) -> int:
    """Keep, compare or time; 1 if a file differs."""
    parser = argparse.ArgumentParser(
        description=tools.answers.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("keep", "compare", "time"))
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--checkout", type=Path, default=ROOT, help="whose code keep runs")
    parser.add_argument("--pairs", type=int, default=5, help="runs of each that time compares")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="some of the cases")
    parsed = parser.parse_args(words)
    first, *others = (folder.resolve() for folder in parsed.folders)
    if len(others) != (parsed.what != "keep"):
        parser.error("keep takes one folder, compare and time take two")
    if parsed.what == "keep":
        seconds = keep(first, parsed.checkout.resolve(), parsed.only)
        print(f"{seconds:.0f} s of CPU time")
        return 0
    if parsed.what == "time":
        with tempfile.TemporaryDirectory(prefix="answers-") as folder:
            compare_times((first, others[0]), parsed.only, Path(folder), parsed.pairs)
        return 0
    files, lines = compare(first, others[0], parsed.only)
    print(*lines, f"{len(lines)} of {files} files differ", sep="\n")
    return bool(lines)


if __name__ == "__main__":
    sys.exit(main())
