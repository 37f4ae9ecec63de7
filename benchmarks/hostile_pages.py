"""Hostile files through every uploader of the real pages: `python -m benchmarks.hostile_pages`.

Each file is given in a new session with a complete project. A project's zip that is accepted is
looked at on all pages. No page may show a traceback.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

from tests.pages.hostile_walk import DOORS, begun, give, hostile


def main() -> int:
    """Run from the command line; 1 if a page showed a traceback."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", type=int, default=13, help="files for each uploader")
    parser.add_argument("--first", type=int, default=1000, help="number of the first file")
    parsed = parser.parse_args()
    began, count, bad = time.monotonic(), 0, 0
    with tempfile.TemporaryDirectory() as home:
        os.environ["STEREOCAL_HOME"] = home
        for door in DOORS:
            slowest = 0.0
            for number in range(parsed.first, parsed.first + parsed.each):
                project, start = begun(Path(home)), time.process_time()
                shown = give(door, hostile(door.reader, number), project)
                slowest = max(slowest, time.process_time() - start)
                count += 1
                if shown:
                    bad += 1
                    print(f"TRACEBACK {door.page}, {door.reader} {number}: {shown[:300]}")
            print(f"{door.page:10} {door.reader:24} slowest {slowest:.1f} s", flush=True)
    print(f"{count} files, {bad} tracebacks, {time.monotonic() - began:.0f} s on the wall")
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
