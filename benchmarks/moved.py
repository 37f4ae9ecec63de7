"""Is a movement found, named and dated, and is none claimed where nothing moved?

    nice python -m benchmarks.moved [STUDY ...] [--trials N] [--data RECORDING ...] [--angles 0.2]

New images of a rig that was calibrated with 25 frames (`refined_rigs`: 0.2 px, lenses and lengths
misjudged as stated), 5 new bars or matched points alone:

- unmoved: false alarms; turns, baseline: 0.05 degrees, and 1 per mille and 1 % of the baseline,
  found; the information bound;
- repaired: error of the repaired pose over the Cramer-Rao bound, and coverage of the intervals;
- points: 0.1 degrees found from 50 matched points;
- focus: a focal length that grew by 0.5 %: found, and named;
- since: a movement among 40 frames: found, and whether the interval holds the frame.

Checked as filmed again, with the secondary turned by 0.2 degrees, and turned from the middle on:

- pairs, balls, tags, fisheyes: `tests.rigs.culprits`; waved: quarters in time of simulated waved
  bars, lenses off by 0.1 to 0.4 px; quarters: of real recordings of two cameras.

Within a real recording of any number of cameras (a pair of one: FOLDER/ewand123:1-3):

- still: parts of 40 frames and more, each half over the next: in how many a camera is said to have
  moved; turned: each camera is turned about its x, y and z axis from a third, the half and three
  quarters of the frames on: how often that is told, with three cameras and more of the right one,
  and how many frames off the frame is (median).
"""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.studies import (
    RECORDING,
    Asked,
    Study,
    exact_interval,
    pair_of,
    parts_in_time,
    recording_of,
    run_studies,
)
from stereocal.errors import StereocalError
from stereocal.field.checking.findings import FOCAL_LEVEL
from stereocal.field.checking.new_images import NewImages, images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.small_steps import baseline_direction, pose_at, pose_places
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import lens_off_by, observe, place_bars
from stereocal.system.array_types import FloatArray
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
from tests.rigs.culprits import KINDS, bars_of, lit, sound
from tests.rigs.mistakes import turned_from
from tests.rigs.refined_rigs import (
    BAR_M,
    DEPTHS_M,
    Misjudged,
    random_rig,
    smooth_fields,
    stated,
    waved_scene,
    with_waves,
)

TURN_RAD = float(np.radians(0.2))
FROM = (1 / 3, 1 / 2, 3 / 4)
LENGTHS = (40, 60, 100, 160, 250)
PAIRS = [*KINDS][:6]


def longer(case: Case, factor: float) -> Rig:
    """The rig with another baseline."""
    pose = case.truth.pose
    return replace(case.truth, pose=Pose(pose.R, pose.T * factor))


def print_unmoved(asked: Asked) -> None:
    """False alarms of 5 bars, and of 50 points."""
    bars = points = focus = 0
    for case in cases(asked.trials, 1):
        found = recheck(case.prior, new_bars(case, case.truth))
        bars += found.changed
        focus += found.p_focal < FOCAL_LEVEL
        points += recheck(case.prior, matched(case, case.truth, 50)).changed
    print(
        f"unmoved, {NEW_BARS} bars: moved {exact_interval(bars, asked.trials)}, {focus} by focus; "
    )
    print(f"unmoved, 50 points: moved {exact_interval(points, asked.trials)}", flush=True)


def print_power(
    asked: Asked,
    move: Callable[[Case], Rig],
    what: str,
    seed: int,
    images_of: Callable[[Case, Rig], NewImages] = new_bars,
) -> None:
    """Movements found, against the bound."""
    found, bounds, verdicts = [], [], []
    for case in cases(asked.trials, seed):
        rig = move(case)
        images = images_of(case, rig)
        result = recheck(case.prior, images)
        found.append(result.changed)
        verdicts.append(result.verdict)
        bounds.append(bound(case, images, rig))
    hits, expected = np.array(found), np.array(bounds)
    told = np.array([verdict == "cannot tell" for verdict in verdicts])
    sigma = 100 * np.sqrt(np.mean(expected * (1 - expected)) / asked.trials)
    print(
        f"{what}: found {100 * hits.mean():.1f} %, bound {100 * expected.mean():.1f} % "
        f"(+- {sigma:.1f}); cannot tell {told.sum()}, same {(~hits & ~told).sum()}"
    )


def print_repaired(asked: Asked) -> None:
    """Errors of repaired poses over the bound, and coverage."""
    rows: list[list[float]] = []
    covered: list[list[bool]] = []
    for case in cases(asked.trials, 4):
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


def print_points(asked: Asked) -> None:
    """Turns of 0.1 degrees from 50 matched points."""
    turned = partial(bumped, angle_rad=np.radians(0.1))
    print_power(asked, turned, "0.1 degrees, 50 points", 5, partial(matched, pairs=50))


def print_focus(asked: Asked) -> None:
    """A focal length that grew by 0.5 %, with and without a movement."""
    for angle in (0.0, 0.3):
        counts = np.zeros(5, dtype=int)
        for case in cases(asked.trials, 6):
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
            f"either {counts[4]} of {asked.trials}",
            flush=True,
        )


def print_since(asked: Asked) -> None:
    """A turn among 40 bars."""
    for angle in (0.0, 0.1, 0.3):
        found = held = named = 0
        widths: list[int] = []
        for case in cases(asked.trials, 7):
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
            f"{np.median(widths) if widths else 0:.0f} frames, of {asked.trials}",
            flush=True,
        )


def print_turns(asked: Asked) -> None:
    """Turns of 0.05 degrees."""
    print_power(asked, lambda case: bumped(case, np.radians(0.05)), "0.05 degrees", 2)


def print_baseline(asked: Asked) -> None:
    """Baselines 1 per mille and 1 % longer."""
    print_power(asked, lambda case: longer(case, 1.001), "baseline 1 per mille longer", 3)
    print_power(asked, lambda case: longer(case, 1.01), "baseline 1 % longer", 3)


def again(data: Pair, seen: Iterable[tuple[str, Pair]], counts: Counter[str]) -> None:
    """Count what is said to have moved, of images that are checked with the refined set."""
    prior = prior_of(refined_parameters(refine(data)))
    for name, each in seen:
        counts[name] += recheck(prior, images_of_bars(each, prior.rig)).verdict == "moved"


def as_moved(still: Pair, axis: FloatArray) -> list[tuple[str, Pair]]:
    """A recording as it is, and with the secondary turned, all the time and from the middle on."""
    turn = TURN_RAD * axis / np.linalg.norm(axis)
    middle = float(np.median(still.correspondences.frames))
    found = [("still", still)]
    for name, frame in (("turned", -np.inf), ("turned half-way", middle)):
        turned = turned_from(still.recording, "secondary", turn, frame + 0.5)
        found.append((name, turned.pair(*CAMERAS)))
    return found


def of_kind(asked: Asked, kinds: Sequence[str]) -> None:
    """The same pair filmed again, in the same light."""
    counts = Counter[str]()
    for number in asked.numbers:
        name, rng = kinds[number % len(kinds)], np.random.default_rng([number, 12])
        kind, (scene, data, _) = KINDS[name], sound(name, number)
        more = bars_of(kind, scene.rig, np.random.default_rng([number, 99]), 300)
        more = replace(more, ends_m=more.ends_m[: kind.frames])
        seen = lit(observe(more, rng, kind.noise_px, data.name), kind.light_px, rng)
        still = data.changed(correspondences=seen.correspondences)
        again(screen(data).dataset, as_moved(still, rng.standard_normal(3)), counts)
    print(f"  moved of {asked.trials}: {dict(counts)}")


def waved(asked: Asked) -> None:
    """Quarters in time of simulated waved bars."""
    counts = Counter[str]()
    for number in asked.numbers:
        rng = np.random.default_rng([number, 31])
        cameras, fields = random_rig(rng), smooth_fields(rng)
        length, misfit = int(rng.choice([10, 20, 40])), float(rng.choice([0.1, 0.2, 0.4]))
        bars = stated(waved_scene(cameras, rng, 320, length), rng, Misjudged(noise_px=0.2))
        for own, rest in parts_in_time(screen(with_waves(bars, fields, misfit)).dataset, 4):
            again(rest, as_moved(own, rng.standard_normal(3)), counts)
    print(f"  moved of {4 * asked.trials}: {dict(counts)}")


def quarters(asked: Asked) -> None:
    """Quarters in time of real recordings."""
    for name in asked.data:
        rng, counts = np.random.default_rng(0), Counter[str]()
        for own, rest in parts_in_time(pair_of(name), 4):
            again(rest, as_moved(own, rng.standard_normal(3)), counts)
        print(f"  {name}: moved of 4: {dict(counts)}", flush=True)


def turned(rows: Recording, name: str, vector: FloatArray, frame: int) -> Recording:
    """One camera turned about its centre from a frame on; points that leave its image are lost."""
    camera, points = rows.cameras[name], rows.points.copy()
    after = (rows.camera == [*rows.cameras].index(name)) & (rows.frame >= frame)
    rays = np.column_stack([camera.undistort(points[after]), np.ones(after.sum())])
    points[after] = camera.project(rays @ Rotation.from_rotvec(vector).as_matrix().T)
    inside = ((points > 0) & (points < np.array(camera.image_size) - 1)).all(axis=1)
    return replace(rows, points=points).where(np.asarray(inside | ~after))


def said(rows: Recording) -> str:
    """What is said of a movement; empty if nothing is."""
    try:
        # `rig` does not take a pair with its own times or lengths, as ewand12 has them.
        two = len(rows.cameras) == 2
        words = (calibrate(rows.pair(*rows.cameras)) if two else calibrate_rig(rows)).warnings
    except StereocalError as error:
        words = (str(error),)
    return next((word for word in words if " moved " in word), "")


def common_frames(rows: Recording) -> list[int]:
    """The frames that two cameras or more see."""
    frames, images = rows.images()
    seen = np.isfinite(images[..., 0]).any(axis=1).sum(axis=1) > 1
    return list(map(int, frames[seen]))


def still(asked: Asked) -> None:
    """Of how many parts it is said that a camera moved."""
    for name in asked.data:
        rows, told, total = recording_of(name), list[str](), 0
        frames = common_frames(rows)
        for length in (*LENGTHS, len(frames)):
            for begin in range(0, len(frames) - length + 1, length // 2):
                part = frames[begin : begin + length]
                words = said(rows.where(np.isin(rows.frame, part)))
                total += 1
                told += [f"{part[0]} to {part[-1]}: {words[:90]}"] * bool(words)
        print(f"  {name}: said to have moved {len(told)} of {total}", *told, sep="\n    ")


def turns(asked: Asked) -> None:
    """How many turns are told."""
    for name, angle in ((name, angle) for name in asked.data for angle in asked.angles):
        rows, found, away = recording_of(name), defaultdict[str, list[bool]](list), list[int]()
        frames = common_frames(rows)
        for camera, share, axis in (
            (camera, share, axis) for camera in rows.cameras for share in FROM for axis in range(3)
        ):
            first = frames[int(share * len(frames))]
            words = said(turned(rows, camera, np.radians(angle) * np.eye(3)[axis], first))
            right = len(rows.cameras) < 3 or f"camera {camera} " in words
            for key in (f"camera {camera}", f"about {'xyz'[axis]}"):
                found[key].append(bool(words) and right)
            if at := re.search(r"(?:frame|and) (\d+)[,:]", words):
                away.append(abs(int(at[1]) - first))
        each = ", ".join(f"{key} {sum(own)} of {len(own)}" for key, own in found.items())
        off = f"; {np.median(away):.0f} frames off" if away else ""
        print(f"  {name}, {angle} degrees: {each}{off}", flush=True)


STUDIES: dict[str, tuple[Study, int]] = {
    "unmoved": (print_unmoved, 1500),
    "turns": (print_turns, 2000),
    "baseline": (print_baseline, 2000),
    "repaired": (print_repaired, 1000),
    "points": (print_points, 1000),
    "focus": (print_focus, 150),
    "since": (print_since, 150),
    "pairs": (partial(of_kind, kinds=PAIRS), 24),
    **{kind: (partial(of_kind, kinds=[kind]), 14) for kind in ("balls", "tags", "fisheyes")},
    "waved": (waved, 14),
    "quarters": (quarters, 1),
    "still": (still, 1),
    "turned": (turns, 1),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__, data=[str(RECORDING)], angles=[0.05, 0.1, 0.2, 0.5])
