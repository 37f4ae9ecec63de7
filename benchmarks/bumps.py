"""Does a check of new images tell the truth? Simulated studies of `field.checking.recheck`.

    nice python -m benchmarks.bumps [STUDY ...] [--trials N]

Each rig is calibrated with 25 frames (`refined_rigs`: 0.2 px, lenses and lengths misjudged as
stated); then come 5 new bars, or matched points alone.

- unmoved: false alarms;
- turns, baseline: 0.05 degrees, and 1 per mille of the baseline, found; the information bound;
- repaired: error of the repaired pose over the Cramer-Rao bound, and coverage of the intervals;
- points: 0.1 degrees found from 50 matched points;
- focus: a focal length that grew by 0.5 %: found, and named;
- since: a movement among 40 frames: found, and whether the interval holds the frame.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.studies import exact_interval, run_studies
from stereocal.field.checking.findings import FOCAL_LEVEL
from stereocal.field.checking.fits import ENOUGH
from stereocal.field.checking.new_images import NewImages, images_of_bars
from stereocal.field.checking.recheck import recheck
from stereocal.fit.least_squares.small_steps import baseline_direction, pose_at, pose_places
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import lens_off_by, place_bars
from tests.rigs.bumps import (
    NEW_BARS,
    Case,
    bound,
    bumped,
    cases,
    joined,
    matched,
    new_bars,
    true_fit,
)
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M


def longer(case: Case, factor: float) -> Rig:
    """The rig with another baseline."""
    pose = case.truth.pose
    return replace(case.truth, pose=Pose(pose.R, pose.T * factor))


def print_unmoved(trials: int) -> None:
    """False alarms of 5 bars, and of 50 points."""
    bars, points, focus, same = 0, 0, 0, 0
    for case in cases(trials, 1):
        found = recheck(case.prior, new_bars(case, case.truth))
        bars += found.changed
        focus += found.p_focal < FOCAL_LEVEL
        same += found.verdict == "same"
        points += recheck(case.prior, matched(case, case.truth, 50)).changed
    print(f"unmoved, {NEW_BARS} bars: moved {exact_interval(bars, trials)}, {focus} by focus; ")
    print(f"unmoved, 50 points: moved {exact_interval(points, trials)}", flush=True)


def print_power(
    trials: int,
    move: Callable[[Case], Rig],
    what: str,
    seed: int,
    images_of: Callable[[Case, Rig], NewImages] = new_bars,
) -> None:
    """Movements found, against the bound."""
    found, bounds, verdicts = [], [], []
    for case in cases(trials, seed):
        rig = move(case)
        images = images_of(case, rig)
        result = recheck(case.prior, images)
        found.append(result.changed)
        verdicts.append(result.verdict)
        bounds.append(bound(case, images, rig))
    hits, expected = np.array(found), np.array(bounds)
    told = np.array([verdict == "cannot tell" for verdict in verdicts])
    sigma = 100 * np.sqrt(np.mean(expected * (1 - expected)) / trials)
    print(
        f"{what}: found {100 * hits.mean():.1f} %, bound {100 * expected.mean():.1f} % "
        f"(+- {sigma:.1f}); cannot tell {told.sum()}, same {(~hits & ~told).sum()}"
    )
    for low, high in ((0.0, 0.2), (0.2, 0.5), (0.5, ENOUGH), (ENOUGH, 0.95), (0.95, 1.01)):
        some = (expected >= low) & (expected < high)
        if some.any():
            print(
                f"  bound {low:.2f} to {min(high, 1):.2f}: {some.sum()} rigs, found "
                f"{100 * hits[some].mean():.1f} %, bound {100 * expected[some].mean():.1f} %, "
                f"cannot tell {told[some].sum()}",
                flush=True,
            )


def print_repaired(trials: int) -> None:
    """Errors of repaired poses over the bound, and coverage."""
    rows: list[list[float]] = []
    covered: list[list[bool]] = []
    for case in cases(trials, 4):
        rig = bumped(case, np.radians(0.5))
        images = new_bars(case, rig)
        result = recheck(case.prior, images)
        exact = true_fit(case, images)
        error = Rotation.from_matrix(pose_at(result.best.at).R @ rig.pose.R.T).as_rotvec()
        C, along = exact.covariance, baseline_direction(exact.at)
        rows.append(
            [
                float(error @ error),
                np.diag(C)[pose_places(1)][:3].sum(),
                (result.repaired.pose.baseline - rig.pose.baseline) ** 2,
                float(along @ C @ along),
            ]
        )
        true_turn = Rotation.from_matrix(rig.pose.R @ case.truth.pose.R.T).magnitude()
        turn, baseline = result.turn[0], result.baseline_m
        assert baseline is not None
        covered.append(
            [
                bool(turn.low <= true_turn <= turn.high),
                baseline.low <= rig.pose.baseline <= baseline.high,
            ]
        )
    mean, shares = np.mean(rows, axis=0), np.mean(covered, axis=0)
    print(
        f"repaired after 0.5 degrees: rotation {np.sqrt(mean[0] / mean[1]):.3f}, baseline "
        f"{np.sqrt(mean[2] / mean[3]):.3f} of the bound; 95 % intervals that hold the truth: turn "
        f"{100 * shares[0]:.1f} %, baseline {100 * shares[1]:.1f} %",
        flush=True,
    )


def print_points(trials: int) -> None:
    """Turns of 0.1 degrees from 50 matched points."""
    turned = partial(bumped, angle_rad=np.radians(0.1))
    print_power(trials, turned, "0.1 degrees, 50 points", 5, partial(matched, pairs=50))


def print_focus(trials: int) -> None:
    """A focal length that grew by 0.5 %, with and without a movement."""
    for angle in (0.0, 0.3):
        counts = np.zeros(5, dtype=int)
        for case in cases(trials, 6):
            rig = bumped(case, np.radians(angle)) if angle else case.truth
            which = CAMERAS[int(case.rng.integers(2))]
            lenses = [
                lens_off_by(lens, 0.005 * (name == which), (0.0, 0.0))
                for name, lens in zip(CAMERAS, (rig.primary, rig.secondary), strict=True)
            ]
            result = recheck(case.prior, new_bars(case, Rig(lenses[0], lenses[1], rig.pose)))
            counts += [
                result.changed,
                bool(result.refocused),
                result.refocused == (which,),
                result.pose_moved == (angle > 0),
                result.ambiguous,
            ]
        print(
            f"focus 0.5 % longer, turned by {angle} degrees: found {counts[0]}, as a refocus "
            f"{counts[1]}, of the right lens alone {counts[2]}, the movement right {counts[3]}, "
            f"either {counts[4]} of {trials}",
            flush=True,
        )


def print_since(trials: int) -> None:
    """A turn among 40 bars."""
    for angle in (0.0, 0.1, 0.3):
        found = held = named = 0
        widths: list[int] = []
        for case in cases(trials, 7):
            first = int(case.rng.integers(8, 33))
            rig = bumped(case, np.radians(angle))
            before, after = (
                place_bars(each, case.rng, n, BAR_M, DEPTHS_M)
                for each, n in ((case.truth, first), (rig, 40 - first))
            )
            result = recheck(
                case.prior, images_of_bars(joined(case, before, after), case.prior.rig)
            )
            found += result.changed
            since = result.since if result.changed else None
            if since is not None:
                named += 1
                held += since.low <= first + 1 <= since.high
                widths.append(since.high - since.low + 1)
        print(
            f"turned by {angle} degrees among 40 bars: found {found}, a change point named "
            f"{named}, its interval holds the frame {held}, median width "
            f"{np.median(widths) if widths else 0:.0f} frames, of {trials}",
            flush=True,
        )


def print_turns(trials: int) -> None:
    """Turns of 0.05 degrees."""
    print_power(trials, lambda case: bumped(case, np.radians(0.05)), "0.05 degrees", 2)


def print_baseline(trials: int) -> None:
    """Baselines 1 per mille and 1 % longer."""
    print_power(trials, lambda case: longer(case, 1.001), "baseline 1 per mille longer", 3)
    print_power(trials, lambda case: longer(case, 1.01), "baseline 1 % longer", 3)


STUDIES: dict[str, tuple[Callable[[int], None], int]] = {
    "unmoved": (print_unmoved, 1500),
    "turns": (print_turns, 2000),
    "baseline": (print_baseline, 2000),
    "repaired": (print_repaired, 1000),
    "points": (print_points, 1000),
    "focus": (print_focus, 150),
    "since": (print_since, 150),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
