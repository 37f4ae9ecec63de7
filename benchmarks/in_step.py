"""Are cameras out of step brought into step, those in step left alone, and is the offset true?

    python -m benchmarks.in_step [STUDY ...] [--rigs N] [--first 0] [--noise 0.2] [--frames 150]

Without being asked for:

- late: pairs 0.3 to 2 frames out of step, of 60 to 250 frames, bars of 3 to 60 px a frame: how many
  offsets are within 4 stated errors of the truth; sound: pairs in step, of six kinds: how many get
  an offset;
- balls, fisheyes, boards: waved before other cameras (`tests.rigs.culprits`, `board_pairs`), late
  and in step;
- rigs: 3 to 5 cameras, each second one late by up to 1.5 frames, and one in any case;
  drifting-rigs: 3 cameras, of which the last drifts by 1e-4 to 1e-3 frames per frame, or does not;
  lenses off by up to 0.4 px; sound-rigs: the same in step, with smooth errors of the lenses, and
  with objects at random places.

With `--time-offset`, two unlike cameras before a moving bar:

- offset: 0.02 to 2 frames either way, with a drift of 1e-5 frames per frame: how often the 68 %
  intervals hold the truth; step: cameras in step: how often an offset is claimed where asked for,
  and applied where not.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.studies import Asked, Study, rms, run_studies
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.parameter_file import of_file
from stereocal.fit.refine import refine
from stereocal.fit.rig_file import rig_file
from stereocal.fit.screening.screen import screen
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.fit.timing.time_offset import CLAIMED
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.rigs import simulated_rig
from stereocal.simulation.simulate import place_bars
from tests.rigs import board_pairs, culprits
from tests.rigs.moving_bar import FRAMES_BETWEEN, move_bar, record
from tests.rigs.moving_wand import wave_wand
from tests.rigs.refined_rigs import (
    BAR_M,
    DEPTHS_M,
    Misjudged,
    misjudged,
    random_rig,
    smooth_fields,
    stated,
    waved_scene,
    with_waves,
)

SEED = 1000
"""Added to the number of a pair or rig."""
VIDEO_PX = 0.3
"""Noise of the centres of a waved bar, which moves while it is exposed."""
DRIFT = 1e-5
NAMES = ("offset", "drift", "yaw", "pitch", "roll", "delta", "epsilon", "baseline")
ONE_SIGMA = 0.9945
"""Standard errors that hold a normal number in 68 % of the cases."""
HELD = 4.0
"""Standard errors within which an offset is right."""
REST, SWAY_M = 10, 1e-4
"""Frames for which a bar rests at a place, and by how much it sways between two."""


def _moving(rng: np.random.Generator, late: float, misfit_px: float = 0.0) -> Pair:
    cameras, off = random_rig(rng), Misjudged(noise_px=float(rng.choice([0.15, 0.3, 0.6])))
    between, frames = int(rng.choice([8, 15, 30, 60])), int(rng.choice([60, 120, 250]))
    bar = move_bar(cameras, rng, frames, BAR_M, DEPTHS_M, between)
    nominal = misjudged(cameras, BAR_M, rng, off)
    data = record(bar, rng, off.noise_px, "moving", TimeOffset(late), nominal)
    return with_waves(data, smooth_fields(rng), misfit_px) if misfit_px else data


def _placed(rng: np.random.Generator, misfit_px: float, rest: bool = False) -> Pair:
    cameras, off = random_rig(rng), Misjudged(noise_px=float(rng.choice([0.15, 0.3, 0.6])))
    count = 12 if rest else int(rng.choice([15, 25, 60]))
    scene = place_bars(cameras, rng, count, BAR_M, DEPTHS_M, 20.0)
    if rest:
        sway = SWAY_M * np.cumsum(rng.standard_normal((REST * count, 1, 3)), axis=0)
        scene = replace(scene, ends_m=np.repeat(scene.ends_m, REST, axis=0) + sway)
    return with_waves(stated(scene, rng, off), smooth_fields(rng), misfit_px)


def _waved(rng: np.random.Generator) -> Pair:
    cameras, off = random_rig(rng), Misjudged(noise_px=float(rng.choice([0.15, 0.3, 0.6])))
    scene = waved_scene(cameras, rng, 200, int(rng.choice([10, 20, 40])))
    return with_waves(stated(scene, rng, off), smooth_fields(rng), float(rng.choice([0.2, 0.5])))


SOUND: Mapping[str, Callable[[np.random.Generator], Pair]] = {
    "moving": lambda rng: _moving(rng, 0.0),
    "moving, lenses off by 0.2 to 1 px": lambda rng: _moving(
        rng, 0.0, float(rng.choice([0.2, 0.5, 1.0]))
    ),
    "waved, lenses off by 0.2 to 0.5 px": _waved,
    "one by one": lambda rng: _placed(rng, 0.0),
    "one by one, lenses off by 0.5 px": lambda rng: _placed(rng, 0.5),
    "at rest for 10 frames, lenses off by 0.3 px": lambda rng: _placed(rng, 0.3, rest=True),
}


def late_pairs(asked: Asked) -> None:
    """How many offsets are found."""
    applied, errors = 0, list[float]()
    for number in asked.numbers:
        rng = np.random.default_rng([SEED + number, 77])
        late = float(rng.uniform(0.3, 2.0) * rng.choice([-1, 1]))
        found = screen(_moving(rng, late)).shift
        if found is not None:
            applied += 1
            errors.append((found.frames - late) / found.sigma)
    _report(f"{applied} of {asked.trials} in step", errors)


def _report(what: str, errors: list[float]) -> None:
    held = int((np.abs(errors) < HELD).sum())
    print(f"  {what}, {held} right, rms error {rms(errors):.2f} of the stated", flush=True)


def sound_pairs(asked: Asked) -> None:
    """How many get an offset."""
    for kind, make in SOUND.items():
        numbers = [SEED + number for number in asked.numbers]
        late = [n for n in numbers if screen(make(np.random.default_rng([n, 77]))).shift]
        print(f"  {kind}: {len(late)} of {asked.trials} get an offset {late or ''}", flush=True)


def of_kind(asked: Asked, kind: str) -> None:
    """Waved bars and boards out of step, and in step."""
    for still in (False, True):
        right = applied = 0
        for number in asked.numbers:
            late = float(np.random.default_rng([number, 8]).uniform(0.3, 1.5))
            late = 0.0 if still else min(late, 0.7) if kind == "boards" else late
            data = (
                with_baseline_found(board_pairs.waved(number, late).dataset)
                if kind == "boards"
                else culprits.waved(number, late, 1, kind, 160, VIDEO_PX)
            )
            found = screen(data).shift
            applied += found is not None
            right += found is not None and abs(found.frames - late) < HELD * found.sigma
        what = "in step" if still else "late"
        print(f"  {what}: {applied} of {asked.trials} get an offset, {right} the right one")


def late_rigs(asked: Asked) -> None:
    """How many rigs have the right offsets."""
    right, errors = 0, list[float]()
    for number in (SEED + each for each in asked.numbers):
        rng = np.random.default_rng([number, 1])
        late = np.zeros(int(rng.choice([3, 4, 5])))
        some = 1 + np.flatnonzero(rng.random(len(late) - 1) < 0.5)
        late[some] = rng.uniform(-1.5, 1.5, len(some))
        late[rng.integers(1, len(late))] = rng.uniform(0.1, 1.5) * rng.choice([-1, 1])
        rig = rig_file(calibrate_rig(wave_wand(number, late, int(rng.choice([100, 200])))[1]))
        stated_errors = [rig.standard_errors[name]["time_offset"] for name in rig.names[1:]]
        if len(rig.names) == len(late) and all(stated_errors):
            off = (np.array([*rig.time_offsets.values()]) - late)[1:] / stated_errors
            errors += off.tolist()
            right += bool((np.abs(off) < HELD).all())
    _report(f"{right} of {asked.trials} rigs right; of their cameras", errors)


def drifting_rigs(asked: Asked) -> None:
    """How many rigs have the right drift, and how many get one that have none."""
    errors, wrong = list[float](), 0
    for number in (SEED + each for each in asked.numbers):
        rng = np.random.default_rng([number, 2])
        late, drift = rng.uniform(0.05, 1.0, 3), float(rng.choice([-1, 1]) * rng.uniform(1, 10))
        late[0], misfit = 0.0, float(rng.choice([0.0, 0.2, 0.4]))
        for put_in in (1e-4 * drift, 0.0):
            recording = wave_wand(number, late, 300, misfit, drift=put_in)[1]
            last = calibrate_rig(recording).offsets[-1]
            wrong += bool(last.drift and not put_in)
            if put_in and last.drift:
                errors.append((last.drift - put_in) / last.drift_sigma)
    of = asked.trials
    _report(f"without a drift {wrong} of {of} found; {len(errors)} of {of} drifts found", errors)


def sound_rigs(asked: Asked) -> None:
    """How many rigs in step get offsets."""

    def still(rng: np.random.Generator, number: int) -> Recording:
        cameras, arc = int(rng.choice([3, 4])), float(rng.choice([60.0, 180.0]))
        return simulated_rig(np.random.default_rng(number), cameras, arc_deg=arc).recording

    def waved(rng: np.random.Generator, number: int) -> Recording:
        misfit = float(rng.choice([0.0, 0.2, 0.5]))
        return wave_wand(number, np.zeros(int(rng.choice([3, 4]))), 150, misfit)[1]

    for kind, make in (("one by one", still), ("waved", waved)):
        late = [
            number
            for number in (SEED + each for each in asked.numbers)
            if calibrate_rig(make(np.random.default_rng([number, 1]), number)).time_offsets.any()
        ]
        print(f"  {kind}: {len(late)} of {asked.trials} get offsets {late or ''}", flush=True)


@dataclass(frozen=True)
class Moving:
    """What is simulated."""

    noise_px: float
    frames: int
    in_step: bool = False


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


def one_rig(study: Moving, number: int) -> Found:
    """Simulate and calibrate one rig."""
    rng = np.random.default_rng([study.frames, FRAMES_BETWEEN, study.in_step, number])
    cameras = random_rig(rng)
    bar = move_bar(cameras, rng, study.frames, BAR_M, DEPTHS_M)
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


def offsets(asked: Asked, in_step: bool = False) -> None:
    """Simulate the rigs in processes, and print what was found."""
    study = Moving(asked.noise, asked.frames, in_step)
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(partial(one_rig, study), asked.numbers, chunksize=5))
    known = [each for each in found if each.errors]
    print(
        f"  {study.noise_px} px, {study.frames} frames: {len(known)} of {asked.trials} determined, "
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


STUDIES: dict[str, tuple[Study, int]] = {
    "late": (late_pairs, 60),
    "sound": (sound_pairs, 60),
    "balls": (partial(of_kind, kind="balls"), 14),
    "fisheyes": (partial(of_kind, kind="fisheyes"), 14),
    "boards": (partial(of_kind, kind="boards"), 3),
    "rigs": (late_rigs, 12),
    "drifting-rigs": (drifting_rigs, 12),
    "sound-rigs": (sound_rigs, 40),
    "offset": (offsets, 400),
    "step": (partial(offsets, in_step=True), 400),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__, noise=0.2, frames=150)
