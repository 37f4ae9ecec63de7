"""Residuals by place: wrong lenses are told from noise, also where frames follow each other."""

import functools

import numpy as np
import pytest

from stereocal.figures.lens import describe_misfit, plot_misfit
from stereocal.fit.errors.misfit import FEWEST_POINTS, Misfit, misfit_of
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from tests.rigs.refined_rigs import Misjudged, waved


@functools.cache
def fit_of(seed: int, wave_px: float, alike_px: float = 0.0) -> RefinedResult:
    """Of 200 frames of a bar that is waved, seen through lenses with smooth errors.

    Args:
        alike_px: errors that frames of a run share, at no place in particular.
    """
    rng, exact = np.random.default_rng([seed, 27]), Misjudged(0.0, 0.0, 0.0, 0.0, 0.2)
    return refine(waved(rng, 200, 10, exact, wave_px, alike_px)[1])


def of_rig(seed: int, wave_px: float, alike_px: float = 0.0) -> Misfit:
    return misfit_of(fit_of(seed, wave_px, alike_px))


def test_a_wrong_lens_is_told_from_noise() -> None:
    """Waves of 0.5 px rms, of which the fit takes up most; measured: shares of 0.019 to 0.22."""
    for seed in range(2):
        wrong, right = of_rig(seed, 0.5), of_rig(seed, 0.0)
        assert wrong.is_sure and sum(field.apart.sum() for field in wrong.fields) > 0
        assert max(wrong.shares) > 0.015 > max(right.shares)
        assert "a lens is wrong" in describe_misfit(wrong)


def test_noise_accuses_no_lens() -> None:
    """Neither noise of single points nor noise that runs of frames share; 1 in 100 may."""
    found = [of_rig(seed, 0.0, alike_px=alike) for seed in range(3) for alike in (0.0, 0.2)]
    assert sum(each.is_sure for each in found) <= 1
    median = float(np.median([each.probability for each in found]))
    assert 0.2 < median < 0.8  # of noise: even; measured: 0.36


def test_the_fit_is_reckoned_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what the fit takes up, random signs give larger sums, and wrong lenses hide."""
    known = [of_rig(seed, 0.2).probability for seed in range(3)]
    monkeypatch.setattr(
        "stereocal.fit.errors.misfit.derivatives_by_rig",
        lambda errors, rig, spread: np.zeros((len(errors(rig)), spread.shape[1])),
    )
    assert np.median([of_rig(seed, 0.2).probability for seed in range(3)]) > np.median(known)


def test_cells_have_enough_points_and_arrows_are_drawn() -> None:
    found = of_rig(0, 0.5)
    for field in found.fields:
        assert (field.count[field.known] >= FEWEST_POINTS).all()
        assert not field.apart[~field.known].any()
    marked = [trace for trace in plot_misfit(found).data if trace.name == "Apart from 0"]
    drawn = sum(len(trace.x) for trace in marked) / 3
    assert drawn == sum(field.apart.sum() for field in found.fields)
    narrow = plot_misfit(found, narrow=True)
    assert narrow.layout.height > plot_misfit(found).layout.height
