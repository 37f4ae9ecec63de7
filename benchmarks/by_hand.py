"""Are real cameras that were started by hand brought into step, and is what is not certain open?

    python -m benchmarks.by_hand [named|alike] [--trials 300] [--first 0] [--draws 0]

Windows of 60 to 400 frames of the real recordings ewand12 and ewand123 (`STEREOCAL_REAL_DATA`), the
second camera's frames counted by itself: offsets of 0 to 10,000 frames and a part of a frame, its
clock 0 to 50 ppm off (both put in by interpolation), 50 to 100 % of the moments in common. Of every
second case noise of 0 to 2 px is added and up to 30 % of the points are missing; of every fifth one
the second camera recorded something else: half a minute later, nothing is in common.

- named: markers with names;
- alike: the two ends look alike: in each image they come left to right, or top to bottom, as
  detection orders them, so that a camera's names change and those of both cameras differ.

Printed: right, open and wrong whole offsets, and how many fractions are in their 95 % intervals.
"""

from collections import Counter
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.studies import RECORDING, Asked, exact_interval, real_data, rms, run_studies
from stereocal.detection.target import in_reading_order
from stereocal.errors import StereocalError
from stereocal.fit.timing.offset_of_pair import OffsetOfPair, offset_of_pair
from stereocal.formats.dataset_files import read_dataset, read_recording
from stereocal.frames.by_motion import found_by_motion
from stereocal.frames.pairing import ByHand
from stereocal.rig.camera import CAMERAS
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import RigidObject
from stereocal.rig.tracks import interpolate
from stereocal.system.array_types import FloatArray

SHORTEST, LONGEST, MOST_OFFSET, MOST_DRIFT = 60, 400, 10_000, 50e-6
WITHIN = 1.96


@dataclass(frozen=True, eq=False)
class Case:
    """Two cameras by their own counts; frame j of the second is taken at `start` + j (1 + `drift`)
    of the first."""

    recording: Recording
    pair: CameraPair
    start: float
    drift: float
    common: bool

    def true_at(self, frame: float) -> float:
        """The offset at a frame of the first camera."""
        return self.start + self.drift * (frame - self.start) / (1 + self.drift)


def recordings() -> list[tuple[Recording, CameraPair]]:
    """The pairs of both recordings, with the numbers of frames as they were recorded."""
    three = read_recording(real_data() / "ewand123")
    pair = read_dataset(RECORDING).recording
    return [(three, pair) for pair in three.pairs] + [(pair, pair.pairs[0])]


def case_of(whole: Recording, pair: CameraPair, rng: np.random.Generator, number: int) -> Case:
    """A window, as two cameras would have counted it that were started by hand."""
    names, common = list(whole.cameras), number % 5 != 4
    width = int(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
    first = int(rng.integers(whole.frame.min(), whole.frame.max() - width))
    later = int(rng.integers(-width // 2, width // 2 + 1)) if common else 0
    if not common:
        width = min(width, 250)
        first = int(rng.integers(0, 619 - 2 * width - 50))
        later = width + 50
    own_start, drift = first + later, float(rng.uniform(-MOST_DRIFT, MOST_DRIFT))
    drift *= number % 3 > 0
    counted = int(rng.integers(0, MOST_OFFSET))
    part = float(rng.uniform(-0.5, 0.5)) if number % 3 else 0.0
    kept = []
    for name, begin in zip(pair, (first, own_start), strict=True):
        own = whole.where(whole.camera == names.index(name))
        if name == pair[1]:
            own = _resampled(own, part, drift)
        kept.append(own.where((own.frame >= begin) & (own.frame < begin + width)))
    points = np.concatenate([own.points for own in kept])
    noise, missing = (rng.uniform(0, 2), rng.uniform(0, 0.3)) if number % 2 else (0.0, 0.0)
    recording = replace(
        whole,
        frame=np.concatenate([kept[0].frame, kept[1].frame - own_start]),
        camera=np.concatenate([own.camera for own in kept]),
        target=np.concatenate([own.target for own in kept]),
        points=points + rng.normal(0, noise, points.shape),
        sigma_px=np.concatenate([own.sigma_px for own in kept]),
    )
    recording = recording.where(_inside(recording) & (rng.random(len(points)) >= missing))
    recording = recording.counted_from({pair[1]: counted})
    start = part + (own_start - counted) * (1 + drift)
    return Case(recording, pair, start, drift, common)


def _resampled(own: Recording, part: float, drift: float) -> Recording:
    """The points of a camera whose frame k is taken at k + part + drift k."""
    late: FloatArray = part + drift * own.frame.astype(np.float64)
    if not np.any(late):
        return own
    found = interpolate(own.target, own.frame, own.points, -late)
    return replace(own, points=found.positions).where(found.known)


def _inside(recording: Recording) -> "np.typing.NDArray[np.bool_]":
    sizes = np.array([camera.image_size for camera in recording.cameras.values()])
    known = (recording.points >= 0) & (recording.points <= sizes[recording.camera] - 1)
    return np.asarray(known.all(axis=1))


def offset_of_alike(case: Case) -> float:
    """The offset where the two ends look alike, by the way of photographs and videos."""
    two, last = case.recording.of_cameras(case.pair), len(case.recording.object.names) - 1
    counts = {str(camera): dict[str, int]() for camera in CAMERAS}
    points = dict[str, FloatArray]()
    for camera, own in enumerate(counts.values()):
        frames, images = two.where(two.camera == camera).images()
        for frame, ends in zip(frames.tolist(), images[:, [0, last], camera], strict=True):
            if np.isfinite(ends).all():
                own[f"{camera} {frame}"] = frame
                points[f"{camera} {frame}"] = ends if in_reading_order(*ends) else ends[::-1]
    orders = [np.arange(2), np.array([1, 0])]
    named = dict(zip(counts, two.cameras.values(), strict=True))
    motion = found_by_motion(ByHand(counts), points, named, RigidObject.bar(1.0), orders)
    return motion.later[CAMERAS[1]] + motion.late[CAMERAS[1]]


def judged(case: Case, found: OffsetOfPair) -> tuple[str, float]:
    """Whether the whole offset is right, and the error of the offset in its standard errors."""
    measured = found.measured
    off = measured.frames - case.true_at(measured.reference)
    right = case.common and abs(off) < 0.5
    return "right" if right else "wrong", off / max(measured.sigma, 1e-9)


def study(asked: Asked, alike: bool) -> None:
    """All cases."""
    counts: Counter[str] = Counter()
    scores: list[float] = []
    every = recordings()
    for number in asked.numbers:
        rng = np.random.default_rng([asked.draws, number])
        whole, pair = every[int(number) % len(every)]
        case = case_of(whole, pair, rng, number)
        kind = "in common" if case.common else "apart"
        try:
            if alike:
                off = offset_of_alike(case) - case.true_at(float(np.median(case.recording.frame)))
                told, score = "right" if case.common and abs(off) < 0.5 else "wrong", np.nan
            else:
                told, score = judged(case, offset_of_pair(case.recording, case.pair))
        except StereocalError as error:
            told, score = "open", np.nan
            print(f"  {number} ({kind}): {error}")
        counts[f"{kind}, {told}"] += 1
        if told == "right":
            scores.append(score)
        elif told == "wrong":
            print(f"  {number} ({kind}): wrong by {score:.1f} standard errors")
    print("  " + ", ".join(f"{name} {count}" for name, count in sorted(counts.items())))
    if not alike:
        within = int((np.abs(scores) < WITHIN).sum())
        held = exact_interval(within, len(scores))
        print(f"  fractions within their 95 % interval: {held}; rms {rms(scores):.2f}")


if __name__ == "__main__":
    studies = {
        "named": (partial(study, alike=False), 300),
        "alike": (partial(study, alike=True), 100),
    }
    run_studies(studies, __doc__, draws=0)
