"""Real recordings by quarters in time, whose frames follow each other.

    python -m benchmarks.quarters {forecast,differences,check} RECORDING...

`forecast`: three quarters fitted, the fourth tested: how many of the 95 % intervals hold.
`differences`: quarters fitted by themselves, lenses and baseline without priors: differences over
their stated errors. `check`: each quarter checked with the parameters of the other three, as it
is, with the secondary turned by 0.2 degrees, and turned from the middle on. A recording is a data
set; or a pair of one with more cameras: ewand123:1-3.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.field.checking.new_images import images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.fit.least_squares.small_steps import step_between
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.dataset_files import read_recording
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import TARGETS, Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.verdict.forecast import forecast_files
from tests.rigs.population import figures_on

QUARTERS = 4
TURN_RAD = float(np.radians(0.2))
METHODS: tuple[Method, ...] = ("2d", "3d", "refined")
FIGURES = ("mean_reprojection_px", "median_error_3d", "p95_error_3d", "fcp_reprojection")
FREE_LENS = LensPrior(np.inf, np.inf)
FREE = RefineSettings(lenses=dict.fromkeys(CAMERAS, FREE_LENS), baseline_sigma_m=np.inf)


def recording(name: str) -> Pair:
    """A data set without the frames that its screening leaves out."""
    path, _, pair = name.partition(":")
    data = pair_to_calibrate(read_recording(path), pair or None)
    own = data.correspondences.rigid_object
    return screen(data if own is None else outer_targets(data, own)).dataset


def outer_targets(data: Pair, own: RigidObject) -> Pair:
    """A and B alone, as in the data set of two cameras: a third marker has errors of its own."""
    rows = data.correspondences
    names = np.array(own.names)[rows.target]
    kept = np.isin(names, TARGETS)
    bars = Correspondences.from_arrays(
        rows.frame[kept], names[kept], rows.primary[kept], rows.secondary[kept]
    )
    a, b = (np.array(own.points[own.names.index(name)]) for name in TARGETS)
    length = float(np.linalg.norm(a - b))
    return data.changed(correspondences=bars, target_distance_m=length)


def quarters(data: Pair) -> Iterator[tuple[IntArray, IntArray]]:
    """The frames of each quarter in time, and those of the other three."""
    frames = data.correspondences.frames
    for own in np.array_split(frames, QUARTERS):
        yield own, np.setdiff1d(frames, own)


def forecast(data: Pair) -> None:
    """Print which intervals hold on the quarter that was not fitted."""
    held: dict[str, list[bool]] = {name: [] for name in FIGURES}
    widths: dict[str, list[float]] = {name: [] for name in FIGURES}
    for number, (own, rest) in enumerate(quarters(data)):
        found = forecast_files(
            calibrate(data.of_frames(rest), CalibrationSettings(), refined=RefineSettings())
        )
        for method in METHODS:
            true = figures_on(data.of_frames(own), found.files[method])
            said = found.draws.figures_of(method)
            for name in FIGURES:
                each = getattr(said, name)
                held[name].append(each.low <= true[name] <= each.high)
                widths[name].append((each.high - each.low) / each.value)
                print(
                    f"  quarter {number + 1} {method:8s} {name:21s} {true[name]:.5f} in "
                    f"{each.low:.5f} to {each.high:.5f}{'' if held[name][-1] else '  MISSED'}"
                )
    for name in FIGURES:
        _report(name, held[name], widths[name])
    without = FIGURES[:3]
    _report(
        "all but FCP",
        [x for f in without for x in held[f]],
        [x for f in without for x in widths[f]],
    )


def _report(name: str, held: list[bool], widths: list[float]) -> None:
    print(f"{name}: {sum(held)} of {len(held)} hold, median width {np.median(widths):.2f}")


def differences(data: Pair) -> None:
    """Print the rms of the differences of quarters over their stated errors."""
    ratio, effects = rms_of_differences(data)
    print(f"rms {ratio:.2f}; design effects {', '.join(f'{each:.1f}' for each in effects)}")


def rms_of_differences(data: Pair) -> tuple[float, list[float]]:
    """The rms of the differences of quarters over their stated errors, and the design effects."""
    fits = [refine(data.of_frames(own), FREE) for own, _ in quarters(data)]
    free = np.flatnonzero(fits[0].unknowns.M[:-1].any(axis=1))
    ratios = []
    for a, b in combinations(fits, 2):
        variances = np.diag(a.covariance)[free] + np.diag(b.covariance)[free]
        ratios.append(step_between(a.at, b.at)[free] / np.sqrt(variances))
    return float(np.sqrt(np.mean(np.square(ratios)))), [fit.design_effect for fit in fits]


def check(data: Pair) -> None:
    """Print what is said of each quarter by the parameters of the others."""
    rng = np.random.default_rng(0)
    for own, rest in quarters(data):
        prior = prior_of(refined_parameters(refine(data.of_frames(rest))))
        still = data.of_frames(own)
        axis = rng.standard_normal(3)
        turned = turned_secondary(still, TURN_RAD * axis / np.linalg.norm(axis), own)
        late = turned_secondary(still, TURN_RAD * axis / np.linalg.norm(axis), own[len(own) // 2 :])
        said = [recheck(prior, images_of_bars(each, prior.rig)) for each in (still, turned, late)]
        effect, least = said[0].noise.design_effect, said[0].power.detectable_turn_rad
        print(
            f"  not moved: {said[0].verdict}; turned by 0.2 degrees: {said[1].verdict}; from "
            f"halfway on: {said[2].verdict}; design effect {effect:.1f}, can be seen from "
            f"{np.degrees(least):.2f} degrees on"
        )
    prior = prior_of(refined_parameters(refine(data)))
    print(f"  against itself: {recheck(prior, images_of_bars(data, prior.rig)).verdict}")


def turned_secondary(data: Pair, vector: FloatArray, frames: IntArray) -> Pair:
    """The data set with the secondary turned in place in these frames; points outside are lost."""
    rows, camera = data.correspondences, data.secondary
    moved = np.isin(rows.frame, frames)
    rays = np.column_stack([camera.undistort(rows.secondary), np.ones(len(rows))])
    seen = camera.project(rays @ Rotation.from_rotvec(vector).as_matrix().T)
    pixels = np.where(moved[:, None], seen, rows.secondary)
    inside = ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=1)
    return data.changed(correspondences=replace(rows, secondary=pixels).where(np.asarray(inside)))


STUDIES = {"forecast": forecast, "differences": differences, "check": check}


def main() -> None:
    """A study of recordings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("recordings", nargs="+")
    parsed = parser.parse_args()
    for name in parsed.recordings:
        print(name)
        STUDIES[parsed.study](recording(name))


if __name__ == "__main__":
    main()
