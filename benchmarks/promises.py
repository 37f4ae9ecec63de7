"""The same promises for pairs, balls, tags and fisheyes: the cells of the table in docs/trust.md.

    python -m benchmarks.promises [wrong|sound|late|moved|stated ...] [--kind balls] [--trials 4]

Kinds are those of `tests.rigs.culprits`; without one: `pairs` (six kinds of bars), balls, tags,
fisheyes. Balls and tags reach a calibration as points: theirs have the noise and the number of
frames that photographs of them give, balls the shift of their centres by light from the side too.

- wrong: each of the mistakes of `tests.rigs.pair_mistakes`: what is said, what the files are worth;
- sound: nothing wrong: how many are accused, how many files are off;
- late: waved bars, 0.3 to 1.5 frames out of step, or in step: how many are brought into step;
- moved: the same pair filmed again: as it stood, and with one camera turned by 0.2 degrees
  (`check`);
- stated: how many of the 95 % intervals of the forecasts hold on 3,000 further bars: of 300, the
  largest errors scatter by a twentieth and more, which is no part of the intervals.
"""

import argparse
import time
import traceback
from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.quarters import FIGURES as WITH_FCP
from benchmarks.quarters import METHODS, TURN_RAD, turned_secondary
from benchmarks.said import MOST, RIGHT, TRACEBACK, WRONG, error_of_files, in_words, judged, said_of
from stereocal.field.checking.new_images import images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.library.calibrations import calibrate
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import Scene, observe
from stereocal.verdict.forecast import forecast_files
from stereocal.workflow.answer import PairAnswer
from tests.rigs.culprits import KINDS, bars_of, lit, sound, waved
from tests.rigs.pair_mistakes import MISTAKES, Mistake
from tests.rigs.population import figures_on

FIGURES = WITH_FCP[:3]
ROWS = ("pairs", "balls", "tags", "fisheyes")
PAIRS = tuple(KINDS)[:6]
FURTHER = 300
POPULATION = 3000
"""Further bars that tell the figure of all, of which the intervals are."""
HELD = 4.0
"""Standard errors within which an offset is right."""
VIDEO_PX = 0.3
"""Noise of the centres of a waved bar, which moves while it is exposed."""


def kind_of(row: str, number: int) -> str:
    """Of pairs, a kind in turn."""
    return PAIRS[number % len(PAIRS)] if row == "pairs" else row


def further(scene: Scene, kind: str, number: int, bars: int = FURTHER) -> Scene:
    """Further bars before the same cameras."""
    return bars_of(KINDS[kind], scene.rig, np.random.default_rng([number, 99]), bars)


def error_of(scene: Scene, kind: str, number: int, answer: PairAnswer) -> float:
    """`error_of_files` on further bars."""
    fresh = further(scene, kind, number)
    cameras = scene.rig.primary, scene.rig.secondary
    pixels = [camera.project(at) for camera, at in zip(cameras, fresh.points_m, strict=True)]
    ends = np.stack(pixels, axis=1).reshape(-1, 2, 2, 2)
    return error_of_files(answer, scene.rig, ends, scene.bar_length_m)


def wrong(row: str, numbers: range, mistakes: list[str], say: bool) -> None:
    """Each kind of mistake."""
    total = Counter[str]()
    for name in mistakes:
        mistake, begun, found, lines = MISTAKES[name], time.monotonic(), Counter[str](), []
        for number in numbers:
            kinds = mistake.kinds if row == "pairs" else (row,)
            word, text = _of_mistake(mistake, kinds[number % len(kinds)], number)
            found[word] += 1
            lines.append(f"      {row} {number}: {word}: {text}")
        total += found
        print(f"  {name}: {in_words(found)} ({time.monotonic() - begun:.0f} s)", flush=True)
        if say:
            print("\n".join(lines), flush=True)
    print(f"  {row}, all: {in_words(total)}")


def _of_mistake(mistake: Mistake, kind: str, number: int) -> tuple[str, str]:
    """What became of a recording with a mistake, as one of the words, and what was said."""
    error = None
    if mistake.change is not None:
        error = partial(error_of, sound(kind, number, mistake.frames)[0], kind, number)
    try:
        said = said_of(partial(mistake.data, number, kind), error)
    except Exception:
        return TRACEBACK, traceback.format_exc()[-400:]
    word = judged(said, mistake.names)
    word = RIGHT if word == WRONG and mistake.harmless else word
    return word, f"{said.error or 0:.1f} times; {said.words[:230]}"


def sound_sets(row: str, numbers: range) -> None:
    """Nothing wrong."""
    accused, off = {}, []
    for number in numbers:
        kind = kind_of(row, number)
        scene, data, _ = sound(kind, number)
        said = said_of(partial(replace, data), partial(error_of, scene, kind, number))
        if said.accusations or said.is_refused:
            accused[f"{kind} {number}"] = said.accusations
        if said.error is None or said.error > MOST:
            off.append(number)
    print(f"  {row}: accused {len(accused)} of {len(numbers)}; files far off {off}")
    for name, notes in accused.items():
        print(f"    {name}: {notes}")


def late(row: str, numbers: range) -> None:
    """Waved bars out of step, and in step."""
    right = wrongly = 0
    for number in numbers:
        kind = kind_of(row, number)
        offset = float(np.random.default_rng([number, 8]).uniform(0.3, 1.5))
        found = screen(waved(number, offset, 1, kind, 160, VIDEO_PX)).shift
        right += found is not None and abs(found.frames - offset) < HELD * found.sigma
        wrongly += screen(waved(number, 0.0, 1, kind, 160, VIDEO_PX)).shift is not None
    count = len(numbers)
    print(f"  {row}: {right} of {count} brought into step; in step, {wrongly} of {count} shifted")


def moved(row: str, numbers: range) -> None:
    """The same pair filmed again."""
    counts = Counter[str]()
    for number in numbers:
        kind, rng = kind_of(row, number), np.random.default_rng([number, 12])
        scene, data, _ = sound(kind, number)
        prior = prior_of(refined_parameters(refine(screen(data).dataset)))
        again = further(scene, kind, number)
        frames = KINDS[kind].frames
        again = replace(again, ends_m=again.ends_m[:frames])
        still = _seen(again, kind, rng, data)
        axis = rng.standard_normal(3)
        turn = TURN_RAD * axis / np.linalg.norm(axis)
        turned = turned_secondary(still, turn, still.correspondences.frames)
        for name, each in (("still", still), ("turned", turned)):
            counts[name] += recheck(prior, images_of_bars(each, prior.rig)).verdict == "moved"
    print(f"  {row}: moved of {len(numbers)}: still {counts['still']}, turned {counts['turned']}")


def _seen(scene: Scene, kind: str, rng: np.random.Generator, given: Pair) -> Pair:
    """Further bars as photographed in the same light, with what was given of the pair."""
    seen = observe(scene, rng, KINDS[kind].noise_px, given.name)
    return given.changed(correspondences=lit(seen, KINDS[kind].light_px, rng).correspondences)


def stated(row: str, numbers: range) -> None:
    """How many intervals hold."""
    held: dict[str, list[bool]] = {name: [] for name in FIGURES}
    widths: dict[str, list[float]] = {name: [] for name in FIGURES}
    for number in numbers:
        kind, rng = kind_of(row, number), np.random.default_rng([number, 13])
        scene, data, _ = sound(kind, number)
        found = forecast_files(calibrate(data))
        test = _seen(further(scene, kind, number, POPULATION), kind, rng, data)
        for method in METHODS:
            true, said = figures_on(test, found.files[method]), found.draws.figures_of(method)
            for name in FIGURES:
                each = getattr(said, name)
                held[name].append(bool(each.low <= true[name] <= each.high))
                widths[name].append((each.high - each.low) / each.value)
    for name in FIGURES:
        share, width = 100 * np.mean(held[name]), np.median(widths[name])
        print(f"  {row}: {name}: {share:.0f} % of {len(held[name])} hold, width {width:.2f}")


STUDIES = {"sound": sound_sets, "late": late, "moved": moved, "stated": stated}


def main() -> None:
    """The cells that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("columns", nargs="*", choices=["wrong", *STUDIES, []], default=[])
    parser.add_argument("--kind", action="append", choices=[*ROWS, *KINDS])
    parser.add_argument("--mistake", action="append", choices=[*MISTAKES])
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--said", action="store_true")
    parsed = parser.parse_args()
    numbers = range(parsed.first, parsed.first + parsed.trials)
    for column in parsed.columns or ["wrong", *STUDIES]:
        for row in parsed.kind or ROWS:
            begun = time.process_time()
            print(f"{column}, {row}, {parsed.trials} trials:", flush=True)
            if column == "wrong":
                wrong(row, numbers, parsed.mistake or [*MISTAKES], parsed.said)
            else:
                STUDIES[column](row, numbers)
            print(f"  ({time.process_time() - begun:.0f} s of CPU time)", flush=True)


if __name__ == "__main__":
    main()
