"""What the runs say: FCP with its interval against known overlaps, threshold, 3D error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from stereocal.calibration.methods import METHODS, Method
from stereocal.evaluation.counting import (
    BIN_WIDTH,
    BINS,
    CORRECT,
    LOWEST,
    OVERFLOW,
    REPROJECTION,
    UNDERFLOW,
    WRONG,
)
from stereocal.evaluation.evaluate import RunCounts
from stereocal.evaluation.summary import (
    BOOTSTRAPS,
    MethodSummary,
    _fcp,
    best_methods,
    merge_bins,
    summarise,
)
from stereocal.system.array_types import FloatArray
from tests.further import further


def run_of(correct: FloatArray, wrong: FloatArray, lengths: FloatArray | None = None) -> RunCounts:
    """A run with these values of both quantities (not their logarithms), alike for all methods."""
    counts = np.zeros((3, 2, 2, BINS + 2), dtype=np.int32)
    for label, values in ((CORRECT, correct), (WRONG, wrong)):
        edges = 10 ** (LOWEST + BIN_WIDTH * np.arange(BINS + 1))
        counts[:, :, label, :BINS] = np.histogram(values, edges)[0]
        counts[:, :, label, UNDERFLOW] = (values < edges[0]).sum()
        counts[:, :, label, OVERFLOW] = (values >= edges[-1]).sum()
    ratios = np.array([1.01, 0.98]) if lengths is None else lengths
    nans = np.zeros((3, 2), dtype=np.int64)
    return RunCounts(counts, nans, np.tile(ratios, (3, 1)), np.zeros((3, 5)), np.ones(3))


def log_normal_runs(
    rng: np.random.Generator, shift: float, spreads: tuple[float, float], runs: int = 100
) -> list[RunCounts]:
    """`runs` runs of 10 correct pairs about 1 and 90 wrong ones `shift` decades above."""
    return [
        run_of(10 ** rng.normal(0.0, spreads[0], 10), 10 ** rng.normal(shift, spreads[1], 90))
        for _ in range(runs)
    ]


def exact_overlap(shift: float, spreads: tuple[float, float]) -> float:
    """Common area of two Gaussians, by the trapezoid rule on 1e-4 decades."""
    x = np.linspace(-15.0, 20.0, 350_001)
    both = np.minimum(norm.pdf(x, 0.0, spreads[0]), norm.pdf(x, shift, spreads[1]))
    return float(np.trapezoid(both, x))


@pytest.mark.parametrize(
    ("shift", "spreads"), [(1.0, (0.5, 0.5)), (2.4, (0.35, 0.6)), (3.2, (0.35, 0.7))]
)
@pytest.mark.parametrize(("studies", "least"), [(60, 0.87), *further((400, 0.92))])
def test_fcp_interval_covers_the_truth(
    shift: float, spreads: tuple[float, float], studies: int, least: float
) -> None:
    """FCP 0.32, 0.011 and 0.0022: 95 % of studies of 100 runs.

    Of 60 studies the share is known to 2.8 %, of 400 to 1.1 %. An interval half as wide, which
    would hold 67 %, is seen by the 60; one narrower by a sixth by the 400.
    """
    rng = np.random.default_rng(0)
    truth = exact_overlap(shift, spreads)
    covered = []
    for study in range(studies):
        counts = np.zeros((100, 3, 2, 2, BINS + 2), dtype=np.int64)
        for label, pairs, mean in ((CORRECT, 10, 0.0), (WRONG, 90, shift)):
            values = rng.normal(mean, spreads[0 if label == CORRECT else 1], (100, pairs))
            bins = np.minimum(np.floor((values - LOWEST) / BIN_WIDTH), OVERFLOW).astype(int)
            np.add.at(counts[:, 1, REPROJECTION, label], (np.arange(100)[:, None], bins), 1)
        covered.append(fcp_covers(counts[:, 1, REPROJECTION], truth, study))
    assert np.mean(covered) >= least
    assert studies < 400 or np.mean(covered) <= 0.98


def fcp_covers(counts: np.ndarray, truth: float, seed: int) -> bool:
    """Only what `summarise` does for one panel: all nine panels would take nine times as long."""
    weights = np.random.default_rng(seed).multinomial(100, np.full(100, 0.01), BOOTSTRAPS // 4)
    found = _fcp(merge_bins(counts, 5), weights)
    return found.low <= truth <= found.high


def test_fcp_is_0_for_separate_and_1_for_equal_samples() -> None:
    apart = run_of(np.linspace(0.1, 0.9, 10), np.linspace(20.0, 90.0, 90))
    fcp = summarise([[apart] * 20])["2d"].reprojection.fcp
    assert fcp.value == fcp.low == 0.0
    assert 0 < fcp.high < 0.05  # none of 200
    values = np.geomspace(0.1, 10.0, 90)
    fcp = summarise([[run_of(values, values)] * 20])["2d"].reprojection.fcp
    assert fcp.value == fcp.high == pytest.approx(1.0, abs=1e-12)
    assert fcp.low > 0.95


@pytest.fixture(scope="module")
def study() -> list[list[RunCounts]]:
    """Three data sets of 8 runs, with lengths of their own; 5 bars each, some without a value."""
    rng = np.random.default_rng(3)
    made = []
    for _ in range(3):
        runs = log_normal_runs(rng, 1.5, (0.4, 0.5), runs=8)
        for at, run in enumerate(runs):
            lengths = 1.004 + 0.01 * rng.standard_normal((3, 5))
            lengths[:, 0] = np.nan if at == 0 else lengths[:, 0]
            runs[at] = replace(run, lengths=lengths, nans=np.array([[3, 1]] * 3))
        made.append(runs)
    return made


def test_pooling_adds_counts(study: list[list[RunCounts]]) -> None:
    pooled = summarise(study)["2d"]
    together = summarise([[run for runs in study for run in runs]])["2d"]
    for one, other in (
        (pooled.residual, together.residual),
        (pooled.reprojection, together.reprojection),
    ):
        assert one.fcp.value == other.fcp.value
        assert one.threshold == other.threshold
        for a, b in ((one.correct, other.correct), (one.wrong, other.wrong)):
            assert np.array_equal(a.density, b.density)
            assert (a.n, a.zeros, a.nans) == (b.n, b.zeros, b.nans)
    assert pooled.reprojection.correct.n == 3 * 8 * 10
    assert pooled.reprojection.wrong.nans == 3 * 8 * 3
    assert pooled.reprojection.correct.nans == 3 * 8
    assert pooled.reconstruction.p95 == together.reconstruction.p95


def test_threshold_of_separate_classes_lies_in_the_gap() -> None:
    run = run_of(np.geomspace(0.01, 1.0, 10), np.geomspace(100.0, 1e4, 90))
    found = summarise([[run] * 5])["2d"].reprojection
    assert 5.0 < found.threshold < 20.0  # the middle of 1 and 100 is 10
    assert found.correct_lost == pytest.approx(0.0, abs=1e-12)
    assert found.wrong_let_in == 0.0


def test_threshold_of_two_equal_gaussians_is_half_way() -> None:
    rng = np.random.default_rng(0)
    found = summarise([log_normal_runs(rng, 2.0, (0.5, 0.5))])["2d"].reprojection
    assert np.log10(found.threshold) == pytest.approx(1.0, abs=0.15)
    # The two shares are the two halves of the overlap.
    assert found.correct_lost + found.wrong_let_in == pytest.approx(found.fcp.value, abs=0.005)


def test_3d_errors_are_those_of_numpy_on_the_pooled_values(study: list[list[RunCounts]]) -> None:
    for at, method in enumerate(METHODS):
        found = summarise(study)[method].reconstruction
        ratios = np.concatenate([run.lengths[at] for runs in study for run in runs])
        known = ratios[~np.isnan(ratios)]
        errors = np.abs(known - 1)
        assert found.median.value == pytest.approx(np.median(errors), rel=1e-12)
        assert found.median.low < found.median.value < found.median.high
        assert found.p95 == pytest.approx(np.percentile(errors, 95), rel=1e-12)
        assert found.mean == pytest.approx(errors.mean(), rel=1e-12)
        assert found.fraction_above_1_percent == np.count_nonzero(errors > 0.01) / len(errors)
        assert found.wand_score == pytest.approx(100 * known.std() / known.mean(), rel=1e-12)
        assert found.mean_length_error == pytest.approx(known.mean() - 1, rel=1e-12)
        assert (found.pdf.n, found.pdf.nans) == (120, 3)


def test_wand_score_does_not_see_the_scale_and_the_mean_error_does() -> None:
    lengths = np.array([0.99, 1.0, 1.01])
    values = np.geomspace(1.0, 2.0, 10)
    right, long = (
        summarise([[run_of(values, values, scale * lengths)] * 2])["3d"].reconstruction
        for scale in (1.0, 1.2)
    )
    assert right.wand_score == pytest.approx(long.wand_score, rel=1e-12)
    assert right.mean_length_error == pytest.approx(0.0, abs=1e-12)
    assert long.mean_length_error == pytest.approx(0.2, rel=1e-9)


def test_best_methods_are_the_least(study: list[list[RunCounts]]) -> None:
    found = summarise(study)

    def changed(method: Method, fcp: float, median: float) -> MethodSummary:
        one = found[method]
        errors = replace(one.reconstruction.median, value=median)
        return replace(
            one,
            residual=replace(one.residual, fcp=replace(one.residual.fcp, value=1 - fcp)),
            reprojection=replace(one.reprojection, fcp=replace(one.reprojection.fcp, value=fcp)),
            reconstruction=replace(one.reconstruction, median=errors),
        )

    figures: dict[Method, tuple[float, float]] = {
        "essential": (0.3, np.nan),
        "2d": (0.1, 0.02),
        "3d": (0.5, 0.01),
    }
    assert best_methods({name: changed(name, *own) for name, own in figures.items()}) == {
        "residual": "3d",
        "reprojection": "2d",
        "reconstruction": "3d",
    }
