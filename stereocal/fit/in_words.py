"""What a rig's file says, in sentences: the same on page, in the report and the command line; and
how well the inputs of a fit are known."""

import math
from collections.abc import Mapping

import numpy as np

from stereocal.fit.about_rig import PairOfRig, RigFigures
from stereocal.fit.errors.held_out import HeldOutErrors
from stereocal.fit.errors.length_in_metres import length_in_words
from stereocal.fit.least_squares import unknowns
from stereocal.fit.rig_file import RigFile
from stereocal.fit.screening.wrong_images import WrongImage
from stereocal.rig.camera import CAMERAS, Camera, camera_in_words
from stereocal.rig.lengths_in_words import are_on_a_line, as_held, side_in_words
from stereocal.rig.pair import Pair
from stereocal.system.numbers import count as counted
from stereocal.system.numbers import rounded

SHOWN = 8
DIGITS = 3
"""Of a time offset, in frames."""
ASSUMED = " (not stated, assumed)"


def rig_sentence(rig: RigFile) -> str:
    """How good the rig is, and which camera is the weakest."""
    figures, count = rig.about.figures, len(rig.cameras)
    if figures is None:
        return f"One rig of {count} cameras."
    weakest = figures.weakest_camera
    error = rig.about.image_errors_px.get(weakest)
    known = ""
    if error is not None:
        known = f": half of its images lie within {rounded(error)} px of where others see the point"
    partner, bars = _best_partner(rig.about.pairs, weakest)
    return (
        f"{_length_in_words(rig, figures)}One rig of {count} cameras: {_accuracy(figures)}. "
        f"The weakest camera is {weakest}{known}; it shares {counted(bars, 'bar')} with {partner}. "
        "More bars that both see, at other places and in other directions, would help most."
        f"{_sides(rig)}"
    )


def _length_in_words(rig: RigFile, figures: RigFigures) -> str:
    """The error of a length in metres; empty if unknown."""
    known, total = rig.object_known, figures.metric_error_p95
    if known is None or total is None:
        return ""
    scatter = figures.to_expect.length_error_p95
    return f"{length_in_words(total, scatter, known, [known.length_m])} "


def _sides(rig: RigFile) -> str:
    """On which side of the first camera another one stands, where the points on a line cannot tell
    a world from its mirror image; else empty."""
    points = np.array([place for name, place in rig.about.object.items() if name != "factor"])
    if not len(points) or not are_on_a_line(points):
        return ""
    first, *others = rig.names
    centres = {name: rig.poses[name].inverse().T for name in others}
    name = max(others, key=lambda other: abs(centres[other][0]))
    return f" {side_in_words(camera_in_words(name), camera_in_words(first), centres[name])}"


def _accuracy(figures: RigFigures) -> str:
    """The errors on frames not fitted, and which these are."""
    held_out = figures.held_out
    if not held_out:
        return f"{rig_errors_in_words(figures)}, on the {figures.frames} frames it was fitted to"
    if "runs" not in held_out:
        return f"{rig_errors_in_words(figures)}, on frames held out of the fit"
    text = f"{rig_errors_in_words(figures)}, on whole runs of frames held out of the fit"
    if "frames" in held_out:
        text += "; on single frames held out, whose neighbours are fitted: "
        text += _errors(held_out["frames"])
    return text


def rig_errors_in_words(figures: RigFigures) -> str:
    """The errors of a rig that are to be expected, relative to the object."""
    return _errors(figures.to_expect)


def _errors(figures: RigFigures | HeldOutErrors) -> str:
    length = figures.length_error_p95
    lengths = "" if length is None else f", 95 % of lengths within {rounded(100 * length)} %"
    return f"{rounded(figures.reprojection_px)} px{lengths}"


def rig_notes(rig: RigFile) -> list[str]:
    """What was left out, what is not connected, and what to check."""
    entries = rig.about
    notes = [*entries.warnings, *entries.not_connected.values()]
    notes += [
        f"The pair {name} was not used: {pair.failed.rstrip('.')}."
        for name, pair in entries.pairs.items()
        if pair.failed is not None
    ]
    if wrong := [wrong_sentence(image) for image in entries.wrong_images]:
        more = f"; {len(wrong) - SHOWN} more" if len(wrong) > SHOWN else ""
        notes.append(f"Left out: {'; '.join(wrong[:SHOWN])}{more}.")
    if frames := entries.frames_left_out:
        more = f" and {len(frames) - SHOWN} more" if len(frames) > SHOWN else ""
        shown = ", ".join(map(str, frames[:SHOWN])) + more
        notes.append(
            "Left out, since they contradict the others and it cannot be told which camera is "
            f"wrong in them: frames {shown}."
        )
    first = rig.names[0]
    for name, offset in rig.time_offsets.items():
        begins = camera_in_words(name, begins=True)
        if apart := rig.start_frames.get(name, 0) - rig.start_frames.get(first, 0):
            notes.append(
                f"{begins} counts its frames {abs(apart)} apart from {first}: its frame "
                f"{max(-apart, 0)} is of the same moment as frame {max(apart, 0)} of {first}."
            )
        if round(offset, DIGITS) or name in rig.drifts:
            error = rig.standard_errors[name]["time_offset"]
            drift = rig.drifts[name].drift_in_words if name in rig.drifts else ""
            notes.append(
                f"{begins} takes its frames {offset:+.{DIGITS}f} ± {error:.{DIGITS}f} "
                f"frame intervals after {camera_in_words(first)}{drift}."
            )
    return notes


def wrong_sentence(image: WrongImage) -> str:
    """What is wrong in an image."""
    camera = camera_in_words(image.camera)
    if image.exchanged:
        return f"frame {image.frame}: the two ends look exchanged in {camera}"
    what = "the object" if image.target is None else f"target {image.target}"
    return f"frame {image.frame}: {what} in {camera}"


def loops_sentence(rig: RigFile) -> str:
    """How far the pairs by themselves were from closing; empty without loops."""
    loops, thirds = rig.about.loops, rig.about.third_camera_px
    if not loops:
        return ""
    worst = max(loops, key=lambda loop: loop.before.translation_m)
    text = (
        f"Pairs by themselves do not close: {' - '.join(worst.cameras)} by "
        f"{rounded(worst.before.rotation_deg)}° and "
        f"{rounded(1000 * worst.before.translation_m)} mm; in the rig they do."
    )
    if thirds:
        most = max(thirds, key=lambda third: third.before)
        text += (
            f" Points of {'-'.join(most.pair)} lie {rounded(most.before)} px off in "
            f"{camera_in_words(most.camera)} with the pairs, {rounded(most.after)} px with the rig "
            "(median)."
        )
    return text


def windows_sentence(rig: RigFile) -> str:
    """Where the windows are, as each camera sees its own; empty without any."""
    found = list[str]()
    for name, camera in rig.cameras.items():
        if camera.window is not None:
            away, error = camera.window.distance_m, rig.standard_errors[name]["window_distance"]
            turned = math.degrees(math.acos(min(camera.window.normal[2], 1.0)))
            found.append(
                f"{rounded(away, 4)} m (± {rounded(1000 * error, 2)} mm) from "
                f"{camera_in_words(name)} and {turned:.1f}° from square to it"
            )
    return f"The window is {', '.join(found)}." if found else ""


def _best_partner(pairs: Mapping[str, PairOfRig], name: str) -> tuple[str, int]:
    """With which camera a camera shares most bars, and how many."""
    shared = [
        (pair.bars, other)
        for pair in pairs.values()
        for camera, other in (pair.cameras, pair.cameras[::-1])
        if camera == name
    ]
    bars, partner = max(shared)
    return partner, bars


def describe_uncertainties(dataset: Pair) -> str:
    """The stated and the assumed uncertainties, in words."""
    sigmas = (dataset.baseline_sigma_m, dataset.target_distance_sigma_m)
    assumed = (
        unknowns.DEFAULT_BASELINE * dataset.baseline_m,
        unknowns.DEFAULT_DISTANCE * dataset.target_distance_m,
    )
    parts = []
    for what, sigma_m, assumed_m in zip(("baseline", "distance A–B"), sigmas, assumed, strict=True):
        mm = rounded(1000 * (assumed_m if sigma_m is None else sigma_m), 3)
        if sigma_m == math.inf:
            parts.append(f"{what} not measured, found from the lengths of the bars")
        else:
            parts.append(f"{what} ± {mm} mm{'' if sigma_m is not None else ASSUMED}")
    for which, camera in zip(CAMERAS, (dataset.primary, dataset.secondary), strict=True):
        parts.append(f"{which} lens {lens_sigmas(camera)}{'' if camera.uncertainty else ASSUMED}")
    return as_held(f"How well the inputs are known: {'; '.join(parts)}.", dataset)


def lens_sigmas(camera: Camera) -> str:
    """The standard deviations of a lens, stated or assumed, in words."""
    prior = unknowns.lens_prior(camera, None)
    return f"± {rounded(100 * prior.focal)} % and ± {rounded(prior.centre_px)} px"
