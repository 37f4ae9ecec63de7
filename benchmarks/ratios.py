"""How much faster the compiled costs and searches are than NumPy.

    python -m benchmarks.ratios

All sides are measured in turn in one run, so that a slow moment of the computer slows them alike.
The ratio is taken within each turn; the tables show its median and the range of the middle 80 %.
"""

import os
import time
from collections.abc import Callable

import numpy as np

from benchmarks.cases import Case, cost_cases, search_cases
from stereocal.system.array_types import FloatArray

TURNS = 31
SEARCH_TURNS = 11
CALLS = 100
COMPILED_CALLS = 5000
LOOP = 30_000
ROUNDING = 1e-6
"""Relative difference that rounding may make: a length is a small difference of long ones."""


def seconds_per_call(function: Callable[[], object], calls: int) -> float:
    """Mean time of one call of `function` over `calls` of them, in seconds."""
    started = time.perf_counter()
    for _ in range(calls):
        function()
    return (time.perf_counter() - started) / calls


def in_turn(sides: list[Callable[[], float]], turns: int) -> FloatArray:
    """Seconds of each side, shape (turns, sides), after a turn that compiles and is not counted."""
    for side in sides:
        side()
    return np.array([[side() for side in sides] for _ in range(turns)])


def row(name: str, seconds: FloatArray, unit: float) -> str:
    """One line of a table; the columns of `seconds` are the compiled side and NumPy."""
    times = " | ".join(f"{value:.3g}" for value in np.median(seconds, axis=0) / unit)
    low, median, high = np.percentile(seconds[:, 1] / seconds[:, 0], [10, 50, 90])
    return f"| {name} | {times} | {median:.0f} ({low:.0f} to {high:.0f}) |"


def cost_rows(case: Case) -> list[str]:
    """One evaluation in a compiled loop, and called from Python, against NumPy."""
    check_same(case.name, case.compiled_cost(), case.plain_cost())
    seconds = in_turn(
        [
            lambda: seconds_per_call(lambda: case.compiled_costs(LOOP), 1) / LOOP,
            lambda: seconds_per_call(case.compiled_cost, COMPILED_CALLS),
            lambda: seconds_per_call(case.plain_cost, CALLS),
        ],
        TURNS,
    )
    return [
        row(f"{case.name}, in a compiled loop", seconds[:, [0, 2]], 1e-6),
        row(f"{case.name}, called from Python", seconds[:, [1, 2]], 1e-6),
    ]


def search_row(case: Case) -> str:
    """One whole search against the same search in Python, with the fast NumPy cost."""
    (cost, evaluations), (plain_cost, plain_evaluations) = (
        case.compiled_search(),
        case.plain_search(),
    )
    check_same(case.name, cost, plain_cost)
    check_same(case.name, float(evaluations), float(plain_evaluations))
    seconds = in_turn(
        [
            lambda: seconds_per_call(case.compiled_search, 5),
            lambda: seconds_per_call(case.plain_search, 1),
        ],
        SEARCH_TURNS,
    )
    return row(f"{case.name}, {evaluations} evaluations", seconds, 1e-3)


def check_same(name: str, first: float, other: float) -> None:
    """Both sides must compute the same, or their times mean nothing.

    Raises:
        RuntimeError: they do not.
    """
    if not np.allclose(other, first, rtol=ROUNDING, atol=0):
        raise RuntimeError(f"{name}: compiled gives {first}, NumPy {other}.")


def main() -> None:
    """Measure and print both tables."""
    print(f"{os.cpu_count()} cores; {TURNS} turns (costs), {SEARCH_TURNS} turns (searches).\n")
    print("One evaluation of 40 correspondences, in microseconds:\n")
    print("| cost | compiled | NumPy | ratio |\n|---|---|---|---|")
    for case in cost_cases():
        print("\n".join(cost_rows(case)), flush=True)
    print("\nOne whole search on 25 frames, in milliseconds:\n")
    print("| search | compiled | Python and NumPy | ratio |\n|---|---|---|---|")
    for case in search_cases():
        print(search_row(case), flush=True)


if __name__ == "__main__":
    main()
