"""Stated intervals of boards that follow each other in time, and of a real recording by its halves.

    python -m benchmarks.waved_boards [single|waved|real] [--rigs 6]

`single`: 20 boards at any places, and `waved`: 80 that are elsewhere every 10 frames; both lenses
have a smooth error of 0.2 px rms that no model contains, and a further recording of the same rig is
tested. `real`: OpenCV's 13 pairs of photographs, halves and three quarters in time; their lenses
are of all photographs. How many of the stated 95 % intervals hold, and their median width over the
value.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.boards import boards_in, cameras_of, uncertainties
from benchmarks.quarters import FIGURES, METHODS
from benchmarks.studies import run_studies
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.intrinsics.stereo_boards import found_of
from stereocal.library.calibrations import calibrate
from stereocal.rig.pair import Pair
from stereocal.rig.rigid_object import BoardPattern
from stereocal.verdict.forecast import forecast_files
from tests.rigs.board_pairs import drawn_rig, seen_by, waved_placings
from tests.rigs.population import figures_on
from tests.rigs.refined_rigs import smooth_fields, with_waves

COLUMNS, ROWS, NOISE_PX, MISFIT_PX, SUBSET = 7, 5, 0.2, 0.2, 20
FURTHER = 60
TRIES = 20
Held = list[tuple[bool, float]]


def held(fitted: Pair, tested: Pair) -> Held:
    """Of each file and figure whether its interval holds, and its width over the value."""
    data, found = with_baseline_found(fitted), []
    forecast = forecast_files(calibrate(data, refined=RefineSettings()))
    tested = tested.changed(baseline_m=data.baseline_m)
    for method in METHODS:
        true = figures_on(tested, forecast.files[method])
        for name in FIGURES:
            said = getattr(forecast.draws.figures[method], name)
            found.append((said.low <= true[name] <= said.high, (said.high - said.low) / said.value))
    return found


def recorded(frames: int, length: int, seed: int) -> tuple[Pair, Pair]:
    """A simulated recording, and a further one of the same rig."""
    for attempt in range(TRIES):
        rng = np.random.default_rng([seed, length, attempt, 77])
        rig, far = drawn_rig(rng)
        square = 0.3 * rig.primary.image_size[0] * far / rig.primary.K[0, 0] / COLUMNS
        board = BoardPattern(COLUMNS, ROWS, float(np.round(square, 4)))
        placings = [waved_placings(rig, far, board, rng, n, length) for n in (frames, FURTHER)]
        if [len(own) for own in placings] == [frames, FURTHER]:
            break
    fields = smooth_fields(rng)
    first, second = (
        with_waves(
            seen_by(rig, board, own, rng, NOISE_PX).recording.pair("primary", "secondary"),
            fields,
            MISFIT_PX,
        )
        for own in placings
    )
    return first, second


def _print(name: str, found: Held) -> None:
    both = np.array(found, dtype=np.float64)
    of_figures = both[:, 0].reshape(-1, len(FIGURES)).mean(axis=0)
    widths = np.median(both[:, 1].reshape(-1, len(FIGURES)), axis=0)
    each = ", ".join(
        f"{figure} {100 * share:.0f} % (width {width:.2f})"
        for figure, share, width in zip(FIGURES, of_figures, widths, strict=True)
    )
    print(f"  {name}: {100 * both[:, 0].mean():.0f} % of {len(both)} hold ({each})", flush=True)


def single(rigs: int) -> None:
    """Boards one by one."""
    _print("20 boards", [each for n in range(rigs) for each in held(*recorded(20, 1, n))])


def waved(rigs: int) -> None:
    """Boards that follow each other."""
    _print("80 frames", [each for n in range(rigs) for each in held(*recorded(80, 10, n))])


def _parts(data: Pair, parts: int) -> Iterator[tuple[Pair, Pair]]:
    frames = data.correspondences.frames
    for own in np.array_split(frames, parts):
        yield data.of_frames(np.setdiff1d(frames, own)), data.of_frames(own)


def real(_: int) -> None:
    """OpenCV's sample."""
    boards = boards_in(Path(os.environ["STEREOCAL_REAL_DATA"]) / "opencv_boards")
    found = found_of(boards, cameras_of(boards, uncertainties(boards, SUBSET)))
    data = found.recording.pair("primary", "secondary")
    for name, parts in (("halves", 2), ("quarters", 4)):
        _print(name, [each for pair in _parts(data, parts) for each in held(*pair)])


if __name__ == "__main__":
    run_studies({"single": (single, 6), "waved": (waved, 6), "real": (real, 1)}, __doc__)
