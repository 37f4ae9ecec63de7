"""Why points lie outside their image: the reading that brings them inside, and fits."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial

import numpy as np

from stereocal.calibration.corrections import with_files, with_pixels
from stereocal.calibration.mistakes import OF_CAMERAS, OF_IMAGES, OF_POINTS
from stereocal.calibration.reading import Reading, readings_of
from stereocal.calibration.wrong_inputs import SCALED
from stereocal.errors import PointsOutsideError, StereocalError
from stereocal.fit.readings.judge import (
    CERTAIN_GAIN,
    OF_NEW_MATRIX,
    Judge,
    JudgedReading,
    same_rows_px,
)
from stereocal.fit.readings.noise_left import ALIKE
from stereocal.fit.readings.wrong_inputs import judges_of
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import rounded

MOST_ALTERNATIVES = 2


@contextmanager
def causes_named() -> Iterator[None]:
    """Errors about points outside their image name the cause, if one explains all points."""
    try:
        yield
    except PointsOutsideError as error:
        raise with_cause(error) from error


def with_cause(error: PointsOutsideError) -> StereocalError:
    """An error that names the cause, if one explains all points; else the same."""
    cause = cause_of(error.recording) if isinstance(error.recording, Recording) else ""
    rows = f"{len(error.problems)} as given; {error.problems[0].reason}"
    return StereocalError(f"{error.source}{cause} (Points outside: {rows}.)") if cause else error


def cause_of(recording: Recording) -> str:
    """What explains points outside their image: a mistake without which all are inside, or one
    whose images may be larger, as of undistorted ones; empty if nothing does.

    A recording that fits as it is, in images of any size, has no cause but for one that fits as
    well and brings all points inside: single points are mistyped.
    """
    try:
        whole = _of_any_size(recording)
    except StereocalError:  # so far outside that no image is as large
        return ""
    for judge in judges_of(whole):
        cameras = [*recording.cameras]
        inside = [
            *judge.exchanged(recording),
            *readings_of(recording, (*OF_IMAGES, *OF_POINTS), judge.groups, cameras),
        ]
        inside = [*filter(_brings_inside, inside)]
        of_lenses = (*OF_CAMERAS, OF_NEW_MATRIX, *SCALED)
        in_larger = readings_of(whole, of_lenses, judge.groups, cameras)
        larger = [_as_stated(reading, recording) for reading in in_larger]
        if explaining := _explaining(judge, inside, larger):
            best, *others = explaining
            alternatives = "".join(f" Or: {claim}." for claim in others[:MOST_ALTERNATIVES])
            return f"{best}{alternatives}"
        if rectified_px := same_rows_px(whole, judge.groups[-1].pair):
            return (
                f"v of each target is the same in both cameras, to {rounded(rectified_px)} px: "
                "these are points of rectified images, which are larger than the camera files say. "
                "Give the size of the rectified images, or leave out what lies outside."
            )
    return ""


def _explaining(judge: Judge, inside: list[Reading], larger: list[Reading]) -> list[str]:
    """What is said of the reading that explains the points best, and the claims of those that do
    about as well; those that change nothing but what is said of the images first."""
    nominal_px = judge.nominal.px
    candidates = [
        *(it for it in judge.judged(inside) if it.noise.px < ALIKE * nominal_px),
        *(it for it in judge.judged(larger) if CERTAIN_GAIN * it.noise.px < nominal_px),
    ]
    limit = ALIKE * min((it.rank for it in candidates), default=0.0)
    order = {id(reading): place for place, reading in enumerate([*inside, *larger])}

    def place(it: JudgedReading) -> int:
        return order[id(it.reading)]

    if not candidates:
        return []
    best, *others = sorted((it for it in candidates if it.rank <= limit), key=place)
    claims = dict.fromkeys(it.reading.claim for it in others)
    return [
        f"{best.reading.claim}: all points would then fit to {rounded(best.noise.px)} px. "
        f"{best.reading.remedy}",
        *(claim for claim in claims if claim != best.reading.claim),
    ]


def _brings_inside(reading: Reading) -> bool:
    with suppress(StereocalError):  # such data are impossible
        return reading.way.corrected().has_all_inside
    return False


def _as_stated(reading: Reading, recording: Recording) -> Reading:
    """The reading with the sizes of images as they are stated, where it names them."""
    if "times" not in reading.words:
        return reading
    width, height = recording.cameras[reading.group.names[0]].image_size
    times = float(reading.words["times"])
    about = f"{width * times:.0f}x{height * times:.0f}"
    return replace(reading, words={**reading.words, "about": about, "size": f"{width}x{height}"})


def _of_any_size(recording: Recording) -> Recording:
    """The same in images that hold all points: larger, by as much on opposite sides."""
    cameras = dict(recording.cameras)
    for number, (name, camera) in enumerate(recording.cameras.items()):
        points = recording.points[recording.camera == number]
        if not len(points):
            continue
        beyond = np.maximum(-points.min(axis=0), points.max(axis=0) + 1.0 - camera.image_size)
        margin = np.ceil(np.maximum(beyond, 0.0))
        K = camera.K.copy()
        K[:2, 2] += margin
        width, height = (np.array(camera.image_size) + 2 * margin.astype(int)).tolist()
        cameras[name] = replace(camera, K=K, image_size=(width, height))
        recording = with_pixels(recording, [name], partial(_moved, by=margin))
    return with_files(recording, cameras)


def _moved(points: FloatArray, _: Camera, by: FloatArray) -> FloatArray:
    return points + by
