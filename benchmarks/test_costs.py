"""Each cost and each search, compiled and in NumPy: `make benchmark`.

The table of each group shows in brackets how many times slower a side is than the fastest of the
group: the ratio. No test asserts a time; `python -m benchmarks.ratios` measures with a spread.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from benchmarks.cases import Case, cost_cases, search_cases

COST_SIDES: dict[str, Callable[[Case], float]] = {
    "compiled": Case.compiled_cost,
    "numpy": Case.plain_cost,
    "numpy-solving": Case.solving_cost,
}
SEARCH_SIDES: dict[str, Callable[[Case], tuple[float, int]]] = {
    "compiled": Case.compiled_search,
    "numpy": Case.plain_search,
}


@pytest.mark.parametrize("side", COST_SIDES)
@pytest.mark.parametrize("case", cost_cases(), ids=lambda case: case.name)
def test_one_evaluation(benchmark: BenchmarkFixture, case: Case, side: str) -> None:
    benchmark.group = f"{case.name} cost of 40 correspondences, called from Python"
    found = benchmark(COST_SIDES[side], case)
    assert found == pytest.approx(case.compiled_cost(), rel=1e-6)


@pytest.mark.parametrize("side", SEARCH_SIDES)
@pytest.mark.parametrize("case", search_cases(), ids=lambda case: case.name)
def test_whole_search(benchmark: BenchmarkFixture, case: Case, side: str) -> None:
    benchmark.group = f"{case.name} search on 25 frames"
    cost, evaluations = benchmark.pedantic(  # type: ignore[no-untyped-call]
        SEARCH_SIDES[side], args=(case,), rounds=3, warmup_rounds=1
    )
    expected_cost, expected_evaluations = case.compiled_search()
    assert cost == pytest.approx(expected_cost, rel=1e-6)
    assert evaluations == expected_evaluations
    benchmark.extra_info["evaluations"] = evaluations
