"""Whether the forecasts hold: simulated rigs, whose files are judged on a large fresh test.

    python -m benchmarks.trust --rigs 20 --frames 25 50 200

For every size of lens error and number of frames: the share of 95 % intervals that hold the
population figure of the written file, the median of true over forecast value, and the median width
of the intervals over the value.
"""

from collections import defaultdict

import numpy as np

from benchmarks.studies import numbers_asked
from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from tests.rigs.population import CASES, one_rig


def report(found: list[dict[Method, dict[str, tuple[float, ...]]]]) -> None:
    """A line for each method and figure."""
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
    for rig in found:
        for method, figures in rig.items():
            for figure, own in figures.items():
                rows[method, figure].append(own)
    for (name, figure), numbers in rows.items():
        true, value, low, high = np.array(numbers).T
        held = (low <= true) & (true <= high)
        n, k = len(held), int(held.sum())
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio, width = true / value, (high - low) / value
        beside = f"{100 * np.mean(true < low):3.0f} below {100 * np.mean(true > high):3.0f} above"
        print(
            f"  {name:9s} {figure:26s} held {100 * k / n:3.0f} %  {beside}  "
            f"true/forecast {np.nanmedian(ratio):5.2f}  width/value {np.nanmedian(width):5.2f}"
        )


def main() -> None:
    """All cells."""
    parsed = numbers_asked(__doc__, rigs=20, frames=[25, 50, 200], first=0)
    everything = []
    for case, off in CASES.items():
        for frames in parsed.frames:
            found = []
            for seed in range(parsed.first, parsed.first + parsed.rigs):
                try:
                    found.append(one_rig(off, frames, seed))
                except StereocalError as error:
                    print(f"  rig {seed}: {error}")
            print(f"{case}; {frames} frames; {len(found)} rigs")
            report(found)
            everything += found
    print("all")
    report(everything)


if __name__ == "__main__":
    main()
