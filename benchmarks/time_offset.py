"""Is the time offset true? Simulated recordings of a moving bar, with known offset and drift.

    python -m benchmarks.time_offset [late|step|slow] [--rigs N] [--noise 0.2] [--frames 150]

- late: offsets of 0.02 to 2 frames either way, with a drift of 1e-5 frames per frame: how often the
  68 % intervals hold the truth;
- step: cameras in step: how often an offset is claimed where asked for, and applied where not;
- slow: the same as late, three times as long, of a bar that moves a quarter as fast.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stereocal.fit.parameter_file import of_file
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.fit.timing.time_offset import CLAIMED
from stereocal.rig.tracks import TimeOffset
from tests.rigs.moving_bar import FRAMES_BETWEEN, move_bar, record
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, Misjudged, misjudged, random_rig

DRIFT = 1e-5
NAMES = ("offset", "drift", "yaw", "pitch", "roll", "delta", "epsilon", "baseline")
ONE_SIGMA = 0.9945
"""Standard errors that hold a normal number in 68 % of the cases."""


@dataclass(frozen=True)
class Study:
    """What is simulated."""

    noise_px: float
    frames: int
    in_step: bool = False
    frames_between: int = FRAMES_BETWEEN


@dataclass(frozen=True)
class Found:
    """Of one rig."""

    errors: tuple[float, ...] = ()
    """Of `NAMES`, in standard errors; empty if no offset was determined."""
    sigma: float = np.nan
    noise_px: float = np.nan
    speed_px: float = np.nan
    claimed: bool = False
    offered: bool = False
    left_out: int = 0


def one_rig(study: Study, number: int) -> Found:
    """Simulate and calibrate one rig."""
    rng = np.random.default_rng([study.frames, study.frames_between, study.in_step, number])
    cameras = random_rig(rng)
    bar = move_bar(cameras, rng, study.frames, BAR_M, DEPTHS_M, study.frames_between)
    late = float(np.exp(rng.uniform(*np.log([0.02, 2.0])))) * rng.choice([-1, 1])
    truth = TimeOffset(late, DRIFT * rng.choice([-1, 1]), study.frames / 2)
    truth = TimeOffset() if study.in_step else truth
    off = Misjudged(noise_px=study.noise_px)
    nominal = misjudged(cameras, BAR_M, rng, off)
    data = record(bar, rng, study.noise_px, "moving", truth, nominal)
    found = screen(data, time_offset=True, time_drift=not study.in_step)
    measured, offered = found.measured_offset, False
    if study.in_step:
        offered = screen(data).shift is not None
    if measured is None:
        return Found(offered=offered)
    settings = replace(off.settings(), time_offset=True, time_drift=not study.in_step)
    fit = refine(found.dataset, settings)
    own, sigma = fit.time_offset, np.sqrt(np.diag(of_file(fit.covariance, fit.pose)))
    turn = np.array(fit.pose.angles) - np.array(cameras.pose.angles)
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    errors = (
        (own.frames - float(truth.at(own.reference))) / own.sigma,
        (own.drift - truth.drift) / own.drift_sigma if own.drift_sigma else np.nan,
        *(turn / sigma[:5]),
        (fit.pose.baseline - cameras.pose.baseline) / sigma[5],
    )
    motion = found.full_dataset.correspondences.motion
    return Found(
        tuple(float(error) for error in errors),
        own.sigma,
        fit.sigma_px.value,
        float(np.nanmedian(np.hypot(motion[:, 0], motion[:, 1]))),
        measured.is_claimed(CLAIMED),
        offered,
        len(found.contradicting),
    )


def print_study(name: str, study: Study, rigs: int) -> None:
    """Simulate the rigs of a study in processes, and print what was found."""
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(partial(one_rig, study), range(rigs), chunksize=5))
    known = [each for each in found if each.errors]
    print(
        f"{name}, {study.noise_px} px, {study.frames} frames: {len(known)} of {rigs} determined, "
        f"{np.median([each.speed_px for each in known]):.1f} px a frame, standard error "
        f"{np.median([each.sigma for each in known]):.2g} frames, noise "
        f"{np.mean([each.noise_px for each in known]):.3f} px, sound frames left out "
        f"{np.mean([each.left_out for each in known]):.3f} a rig"
    )
    print(
        f"  claimed where asked for: {sum(each.claimed for each in found)}, "
        f"applied unasked: {sum(each.offered for each in found)}"
    )
    for quantity, errors in zip(NAMES, np.array([each.errors for each in known]).T, strict=True):
        if np.isnan(errors).any():  # not fitted
            continue
        print(
            f"  {quantity}: 68 % intervals hold {100 * np.mean(np.abs(errors) < ONE_SIGMA):.1f} %, "
            f"errors {np.std(errors):.2f}, mean {np.mean(errors):+.2f} standard errors",
            flush=True,
        )


def main() -> None:
    """Run the studies named on the command line, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("studies", nargs="*", choices=["late", "step", "slow", []], default=[])
    parser.add_argument("--rigs", type=int, default=400)
    parser.add_argument("--noise", type=float, default=0.2)
    parser.add_argument("--frames", type=int, default=150)
    parsed = parser.parse_args()
    study = Study(parsed.noise, parsed.frames)
    studies = {
        "late": study,
        "step": replace(study, in_step=True),
        "slow": replace(study, frames=3 * parsed.frames, frames_between=4 * FRAMES_BETWEEN),
    }
    for name in parsed.studies or studies:
        print_study(name, studies[name], parsed.rigs)


if __name__ == "__main__":
    main()
