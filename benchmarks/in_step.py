"""Are cameras out of step brought into step though nobody asks, and those in step left alone?

    python -m benchmarks.in_step [late|sound|rigs|drifting-rigs|sound-rigs] [--rigs 60]
        [--seed 1000]

- late: pairs 0.3 to 2 frames out of step, of 60 to 250 frames, bars of 3 to 60 px a frame: how many
  offsets are within 4 stated errors of the truth;
- sound: pairs in step, of six kinds: how many get an offset;
- rigs: 3 to 5 cameras, each second one late by up to 1.5 frames, and one in any case;
- drifting-rigs: 3 cameras, of which the last drifts by 1e-4 to 1e-3 frames per frame, or does not;
  lenses off by up to 0.4 px;
- sound-rigs: the same in step, with smooth errors of the lenses, and with objects at random places.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.rig_file import rig_file
from stereocal.fit.screening.screen import screen
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.rigs import simulated_rig
from stereocal.simulation.simulate import place_bars
from tests.rigs.moving_bar import move_bar, record
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


def late_pairs(rigs: int, seed: int) -> None:
    """Print how many offsets are found."""
    applied, held, errors = 0, 0, list[float]()
    for number in range(rigs):
        rng = np.random.default_rng([seed + number, 77])
        late = float(rng.uniform(0.3, 2.0) * rng.choice([-1, 1]))
        found = screen(_moving(rng, late)).shift
        if found is not None:
            applied += 1
            errors.append((found.frames - late) / found.sigma)
            held += abs(errors[-1]) < HELD
    rms = np.sqrt(np.mean(np.square(errors)))
    print(f"late: {applied} of {rigs} in step, {held} right, rms error {rms:.2f} of the stated")


def sound_pairs(rigs: int, seed: int) -> None:
    """Print how many get an offset."""
    for kind, make in SOUND.items():
        numbers = range(seed, seed + rigs)
        late = [n for n in numbers if screen(make(np.random.default_rng([n, 77]))).shift]
        print(f"{kind}: {len(late)} of {rigs} get an offset {late or ''}", flush=True)


def late_rigs(rigs: int, seed: int) -> None:
    """Print how many rigs have the right offsets."""
    right, errors = 0, list[float]()
    for number in range(seed, seed + rigs):
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
    rms = np.sqrt(np.mean(np.square(errors)))
    print(f"late rigs: {right} of {rigs} right, rms error {rms:.2f} of the stated")


def drifting_rigs(rigs: int, seed: int) -> None:
    """Print how many rigs have the right drift, and how many get one that have none."""
    right, errors, wrong = 0, list[float](), 0
    for number in range(seed, seed + rigs):
        rng = np.random.default_rng([number, 2])
        late, drift = rng.uniform(0.05, 1.0, 3), float(rng.choice([-1, 1]) * rng.uniform(1, 10))
        late[0], misfit = 0.0, float(rng.choice([0.0, 0.2, 0.4]))
        for put_in in (1e-4 * drift, 0.0):
            recording = wave_wand(number, late, 300, misfit, drift=put_in)[1]
            last = calibrate_rig(recording).offsets[-1]
            wrong += bool(last.drift and not put_in)
            if put_in and last.drift:
                errors.append((last.drift - put_in) / last.drift_sigma)
                right += abs(errors[-1]) < HELD
    rms = np.sqrt(np.mean(np.square(errors)))
    print(
        f"drifting rigs: of {rigs}, {len(errors)} drifts found, {right} right, rms error {rms:.2f} "
        f"of the stated; without one, {wrong} of {rigs} found"
    )


def sound_rigs(rigs: int, seed: int) -> None:
    """Print how many rigs in step get offsets."""

    def still(rng: np.random.Generator, number: int) -> Recording:
        cameras, arc = int(rng.choice([3, 4])), float(rng.choice([60.0, 180.0]))
        return simulated_rig(np.random.default_rng(number), cameras, arc_deg=arc).recording

    def waved(rng: np.random.Generator, number: int) -> Recording:
        misfit = float(rng.choice([0.0, 0.2, 0.5]))
        return wave_wand(number, np.zeros(int(rng.choice([3, 4]))), 150, misfit)[1]

    for kind, make in (("one by one", still), ("waved", waved)):
        late = [
            number
            for number in range(seed, seed + rigs)
            if calibrate_rig(make(np.random.default_rng([number, 1]), number)).time_offsets.any()
        ]
        print(f"rigs, {kind}: {len(late)} of {rigs} get offsets {late or ''}", flush=True)


STUDIES = {
    "late": late_pairs,
    "sound": sound_pairs,
    "rigs": late_rigs,
    "drifting-rigs": drifting_rigs,
    "sound-rigs": sound_rigs,
}


def main() -> None:
    """The studies named on the command line, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("studies", nargs="*", choices=[*STUDIES, []], default=[])
    parser.add_argument("--rigs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1000)
    parsed = parser.parse_args()
    for name in parsed.studies or STUDIES:
        STUDIES[name](parsed.rigs, parsed.seed)


if __name__ == "__main__":
    main()
