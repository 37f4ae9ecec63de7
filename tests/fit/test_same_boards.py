"""Covariance where the same boards gave both lenses and the pose."""

import numpy as np

from stereocal.fit.least_squares.design_effect import WORTH, covariance_of_boards
from stereocal.fit.least_squares.unknowns import Unknowns

BOARDS = 60


def test_errors_that_both_lenses_share_do_not_count_in_the_pose() -> None:
    """A pose that is known but for the difference of two lens errors, which are nearly the same."""
    rng = np.random.default_rng(0)
    of_boards = rng.normal(size=(BOARDS, 1)) + 0.1 * rng.normal(size=(BOARDS, 2))
    precision = np.diag([0.0, BOARDS, BOARDS])
    unknowns = Unknowns(
        ("pose", "primary cx", "secondary cx"),
        np.zeros(3),
        np.eye(3),
        np.array([np.inf, BOARDS**-0.5, BOARDS**-0.5]),
        precision,
    )
    J = np.array([1.0, 1.0, -1.0]) / 0.1
    noise = rng.normal(size=BOARDS)
    equations = {
        str(i): (np.outer(J, J), J * residual) for i, residual in enumerate(noise - noise.mean())
    }
    mean = of_boards.mean(axis=0)
    without = {
        str(i): np.append(0.0, (mean - own) / (BOARDS - 1)) for i, own in enumerate(of_boards)
    }
    by_model = unknowns.covariance(BOARDS * np.outer(J, J))
    found = covariance_of_boards(unknowns, by_model, equations, without)
    share = WORTH / (WORTH + BOARDS - 1)
    of_sandwich = (found - share * by_model) / (1 - share)
    np.testing.assert_allclose(of_sandwich[0, 0], 0.03 / BOARDS, rtol=0.5)  # model: 2 / BOARDS
    np.testing.assert_allclose(np.diag(of_sandwich)[1:], 1.0 / BOARDS, rtol=0.4)
    assert of_sandwich[1, 2] > 0.9 * of_sandwich[1, 1]
