"""What the ordinary mistakes of a first hour do: exchanged frames, wrong points, wrong inputs.

    python -m benchmarks.ordinary_path [frames|points|inputs] [--rigs 40]

Rigs are drawn with unlike cameras (`refined_rigs`), 25 frames, 0.2 px of noise, lenses off by 0.3 %
and 5 px, the baseline by 5 mm, the bar by 0.5 mm; uncertainties are stated as they are. More kinds
of rigs and of mistakes: `benchmarks.promises`.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.studies import run_studies
from stereocal.calibration.corrections import scaled
from stereocal.errors import StereocalError
from stereocal.fit.errors.disagreement import compare_inputs
from stereocal.fit.errors.stated_inputs import undetectable_errors
from stereocal.fit.refine import refine
from stereocal.library.calibrations import calibrate
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import lens_off_by
from stereocal.verdict.in_words import why_not_trusted
from tests.rigs.accuracy import turned
from tests.rigs.mistakes import flipped, rig, with_frames_exchanged, with_points_off
from tests.rigs.refined_rigs import Misjudged


def frames(rigs: int) -> None:
    """1, 2 and 3 of 25 frames exchanged in one camera."""
    print("A and B exchanged in one camera: rotation error over the clean one's, 2D and 3D set")
    for count in (0, 1, 2, 3):
        refused = exact = sound_named = 0
        within = {"2d": 0, "3d": 0}
        for number in range(rigs):
            scene, data, rng = rig(number)
            truth = scene.rig.pose
            clean = calibrate(data)
            spoiled, bad = with_frames_exchanged(data, rng, count)
            try:
                found = calibrate(spoiled)
            except StereocalError:
                refused += 1
                continue
            exact += found.screening.left_out == bad
            sound_named += len(set(found.screening.left_out) - set(bad))
            for method in ("2d", "3d"):
                limit = 1.5 * turned(clean.methods[method].pose, truth) + np.radians(0.3)
                within[method] += turned(found.methods[method].pose, truth) <= limit
        print(
            f"  {count} of 25: refused {refused}, exactly these named {exact} of {rigs}, sound "
            f"frames named {sound_named} of {rigs * (25 - count)}; within 1.5 times + 0.3 degrees: "
            f"2D {within['2d']}, 3D {within['3d']}"
        )


def points(rigs: int) -> None:
    """30 % of the points off by 20 to 100 px."""
    right = refused = wrong = cautioned = 0
    for number in range(rigs):
        scene, data, rng = rig(number)
        truth = scene.rig.pose
        clean = calibrate(data)
        spoiled, bad = with_points_off(data, rng)
        try:
            found = calibrate(spoiled)
        except StereocalError:
            refused += 1
            continue
        limit = 2.0 * turned(clean.methods["2d"].pose, truth) + np.radians(0.5)
        good = turned(found.methods["2d"].pose, truth) <= limit
        good &= set(found.screening.left_out) <= set(bad)
        right += good
        wrong += not good
        cautioned += bool(why_not_trusted(found))
    print(
        f"30 % of the points off: {right} of {rigs} right (2D rotation within twice the clean "
        f"one's plus 0.5 degrees, only bad frames left out), {refused} refused, {wrong} wrong; "
        f"{cautioned} told not to be relied on"
    )


def far_off(camera: Camera) -> Camera:
    """The lens with a focal length 2 % too long."""
    return lens_off_by(camera, 0.02, (0.0, 0.0))


WRONG: dict[str, tuple[Callable[[Pair], Pair], str]] = {
    "baseline 3 %": (lambda d: d.changed(baseline_m=1.03 * d.baseline_m), "baseline"),
    "bar 2 %": (lambda d: d.changed(target_distance_m=1.02 * d.target_distance_m), "distance"),
    "focal length 2 %": (lambda d: d.changed(primary=far_off(d.primary)), "primary focal"),
    "distortion sign, primary": (
        lambda d: d.changed(primary=flipped(d.primary)),
        "primary camera's distortion",
    ),
    "distortion sign, secondary": (
        lambda d: d.changed(secondary=flipped(d.secondary)),
        "secondary camera's distortion",
    ),
    "K of half the image": (
        lambda d: d.changed(primary=scaled(d.primary, 0.5)),
        "primary camera's lens",
    ),
    "K of twice the image": (
        lambda d: d.changed(secondary=scaled(d.secondary, 2.0)),
        "secondary camera's matrix K",
    ),
}
"""A wrong input, and the words that name it in a message, or as an accused input or its rival."""


def said_of(number: int, change: Callable[[Pair], Pair], words: str) -> tuple[bool, bool, bool]:
    """Whether the words are said of a rig with a change, it is refused, and any input accused."""
    _, data, _ = rig(number)
    stated = replace(Misjudged().settings(), baseline_sigma_m=None, distance_sigma_m=None)
    try:
        found = calibrate(change(data), refined=stated)
    except StereocalError as error:
        return words in str(error), True, False
    items = found.inputs
    accused = [key for item in items if item.accused for key in (item.key, *item.rivals)]
    return words in " ".join(found.warnings) or words in accused, False, bool(accused)


def inputs(rigs: int) -> None:
    """Each wrong input, and sound ones."""
    for name, (change, words) in WRONG.items():
        said = [said_of(number, change, words) for number in range(rigs)]
        named, refused, _ = np.sum(said, axis=0)
        print(f"  {name}: named {named} of {rigs}, refused {refused}")
    sound = [said_of(number, lambda data: data, "sound") for number in range(5 * rigs)]
    print(f"  sound rigs accused: {sum(a or r for _, r, a in sound)} of {5 * rigs}")
    asked = 0
    for number in range(rigs):
        _, data, _ = rig(number)
        unstated = data.changed(baseline_sigma_m=None, target_distance_sigma_m=None)
        asked += bool(undetectable_errors(compare_inputs(refine(unstated)).inputs))
    print(f"  nothing stated: asked for in {asked} of {rigs}")


STUDIES = {"frames": (frames, 40), "points": (points, 40), "inputs": (inputs, 40)}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
