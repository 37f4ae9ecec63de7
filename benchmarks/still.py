"""Cameras that stood still before lenses that are not as their model: is a movement claimed?

    python -m benchmarks.still [check|rigs|halves] [--rigs 14] [--seed 200]

- check: simulated waved bars, lenses off by 0.1 to 0.4 px: quarters in time checked with the other
  three, as they are, with the secondary turned by 0.2 degrees, and turned from the middle on;
- rigs: wands waved before 3 to 5 such cameras: how many rigs say that a camera moved, as they are,
  and with one turned by 0.2 degrees;
- halves: differences of both halves in time of such rigs over their stated errors, and what each
  states of its images over what the other half shows.
"""

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.quarters import TURN_RAD, quarters, turned_secondary
from stereocal.field.checking.new_images import images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.small_steps import lens_places
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.least_squares.views import EACH
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.fit.screening.screen import screen
from stereocal.rig.recording import Recording
from stereocal.system.array_types import BoolArray
from tests.rigs.moving_wand import stated_over_true, wave_wand
from tests.rigs.refined_rigs import (
    Misjudged,
    random_rig,
    smooth_fields,
    stated,
    waved_scene,
    with_waves,
)
from tests.rigs.spoiled_rigs import bumped_from

FRAMES, NOISE_PX = 320, 0.2
FREE = LensPrior(0.05, 50.0)
Z = list[float]


def check(rigs: int, seed: int) -> None:
    """Print how many quarters of pairs have moved."""
    moved, total = Counter[str](), 0
    for number in range(seed, seed + rigs):
        rng = np.random.default_rng([number, 31])
        cameras, fields = random_rig(rng), smooth_fields(rng)
        length, misfit = int(rng.choice([10, 20, 40])), float(rng.choice([0.1, 0.2, 0.4]))
        bars = stated(waved_scene(cameras, rng, FRAMES, length), rng, Misjudged(noise_px=NOISE_PX))
        data = screen(with_waves(bars, fields, misfit)).dataset
        for own, rest in quarters(data):
            prior = prior_of(refined_parameters(refine(data.of_frames(rest))))
            axis, still = rng.standard_normal(3), data.of_frames(own)
            turn = TURN_RAD * axis / np.linalg.norm(axis)
            seen = {
                "still": still,
                "turned": turned_secondary(still, turn, own),
                "turned halfway": turned_secondary(still, turn, own[len(own) // 2 :]),
            }
            total += 1
            for name, each in seen.items():
                found = recheck(prior, images_of_bars(each, prior.rig))
                moved[name] += found.verdict == "moved"
    print(f"check: moved of {total}: {dict(moved)}")


def rigs_still(rigs: int, seed: int) -> None:
    """Print how many rigs say that a camera moved."""
    moved = Counter[str]()
    for number in range(seed, seed + rigs):
        rng = np.random.default_rng([number, 3])
        late, misfit = np.zeros(int(rng.choice([3, 4, 5]))), float(rng.choice([0.1, 0.2, 0.4]))
        truth, recording = wave_wand(number, late, int(rng.choice([100, 200, 300])), misfit)
        name, frames = f"c{rng.integers(len(late)) + 1}", np.unique(recording.frame)
        at = int(frames[int(len(frames) * rng.uniform(0.3, 0.7))])
        turned = bumped_from(replace(truth, recording=recording), name, 0.2, at)
        for what, each in (("still", recording), ("turned", turned)):
            warnings = calibrate_rig(each, late=False).warnings
            moved[what] += any("moved" in warning for warning in warnings)
    print(f"rigs: moved of {rigs}: {dict(moved)}")


def halves(rigs: int, seed: int) -> None:
    """Print the rms of the differences of halves over their stated errors, and stated over true
    errors in images."""
    poses, lenses, images = Z(), Z(), Z()
    for number in range(seed, seed + rigs):
        rng = np.random.default_rng([number, 4])
        late, misfit = np.zeros(int(rng.choice([3, 4, 5]))), float(rng.choice([0.1, 0.2, 0.4]))
        recording = wave_wand(number, late, 300, misfit)[1]
        parts = [recording.where(half) for half in _halves(recording)]
        both = [_calibrated(part) for part in parts]
        images += stated_over_true(both[0], parts[1]) + stated_over_true(both[1], parts[0])
        if both[0].names == both[1].names:
            found = differences(*both)
            poses += found[0]
            lenses += found[1]
    values = (np.sqrt(np.mean(np.square(each))) for each in (poses, lenses))
    print("halves: rms of poses {:.2f}, of lenses {:.2f} stated errors".format(*values))
    of_images = *np.quantile(images, [0.05, 0.5, 0.95]), len(images)
    print(
        "images, stated over true: {1:.2f} ({0:.2f} to {2:.2f}) of {3} cameras".format(*of_images)
    )


def _halves(recording: Recording) -> list[BoolArray]:
    frames = np.array_split(np.unique(recording.frame), 2)
    return [np.isin(recording.frame, half) for half in frames]


def _calibrated(recording: Recording) -> RigCalibration:
    lenses = dict.fromkeys(recording.cameras, FREE)
    settings = RefineSettings(lenses, baseline_sigma_m=np.inf)
    return calibrate_rig(recording, settings, late=False)


def differences(one: RigCalibration, other: RigCalibration) -> tuple[Z, Z]:
    """Of the poses and of the lenses, over the stated errors."""
    variances, q = np.diag(one.covariance + other.covariance), one.fit.q - other.fit.q
    poses, lenses = Z(), Z()
    for number, name in enumerate(one.names):
        a, b = one.poses[name], other.poses[name]
        places = [place for place in lens_places(number) if variances[place] > 0.0]
        lenses += (q[places] / np.sqrt(variances[places])).tolist()
        if number:
            apart = [*Rotation.from_matrix(a.R @ b.R.T).as_rotvec(), *(a.T - b.T)]
            own = variances[EACH * number : EACH * number + 6]
            poses += (np.array(apart) / np.sqrt(own)).tolist()
    return poses, lenses


STUDIES = {"check": check, "rigs": rigs_still, "halves": halves}


def main() -> None:
    """The studies named on the command line, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("studies", nargs="*", choices=[*STUDIES, []], default=[])
    parser.add_argument("--rigs", type=int, default=14)
    parser.add_argument("--seed", type=int, default=200)
    parsed = parser.parse_args()
    for name in parsed.studies or STUDIES:
        STUDIES[name](parsed.rigs, parsed.seed)


if __name__ == "__main__":
    main()
