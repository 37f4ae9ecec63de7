"""Frames: target positions in the photographs with their standard errors and source.

Detection writes them, review corrects them, and the table of points is made from them.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, get_args

import numpy as np

from stereocal.detection.detect import State
from stereocal.errors import StereocalError, damaged
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import SOURCES, TARGETS, Correspondences
from stereocal.system.array_types import FloatArray
from stereocal.system.names import can_be_shown
from stereocal.system.numbers import count
from stereocal.system.records import of_plain
from stereocal.system.tables import LARGEST_WHOLE

LARGEST_PX = 1_000_000
FRAMES_FORMAT = "stereocal-frames/1"
STATES: tuple[State, ...] = get_args(State)


@dataclass(frozen=True)
class Centre:
    """The centre of one target in one photograph, in raw pixels."""

    u: float
    v: float
    sigma_px: float | None = None
    """Standard error of one coordinate; None where it is not known."""
    source: str = "detected"
    """One of `dataset.SOURCES`."""


CentrePair = tuple[Centre | None, Centre | None]
"""Targets A and B of one photograph."""


@dataclass(frozen=True)
class Frame:
    """One frame: its two photographs and the targets in them."""

    frame: int
    files: tuple[str, str]
    """Names of the photographs, primary and secondary."""
    centres: tuple[CentrePair, CentrePair]
    """The centres by camera, then by target."""
    state: State
    reason: str = ""
    """Why it is doubtful or refused, or what was changed, for example a swap."""
    use: bool = True
    """Whether its targets go into the table of points."""
    reviewed: bool = False
    """Whether the user has decided on it (`review`)."""
    corrected: bool = False
    """Whether the user has moved, placed or exchanged targets in it."""

    @property
    def targets_in_both(self) -> list[int]:
        """The targets (0 A, 1 B) that both photographs show."""
        return [t for t in (0, 1) if all(self.centres[camera][t] for camera in (0, 1))]

    @property
    def places(self) -> FloatArray:
        """(2, 2, 2): raw pixels by target, camera, (u, v), if all targets are placed."""
        return np.array([[(c.u, c.v) for c in seen if c] for seen in self.centres]).swapaxes(0, 1)

    def used(self, use: bool) -> "Frame":
        """The same frame, used or left out."""
        return replace(self, use=use)

    def moved(self, camera: int, target: int, centre: Centre | None) -> "Frame":
        """The same frame with one centre replaced, or removed (None)."""
        rows = [list(self.centres[0]), list(self.centres[1])]
        rows[camera][target] = centre
        (a, b), (c, d) = rows
        return replace(self, centres=((a, b), (c, d)))

    def swapped(self, camera: int) -> "Frame":
        """The same frame with targets A and B exchanged in one camera."""
        a, b = self.centres[camera]
        return self.moved(camera, 0, b).moved(camera, 1, a)


def correspondences_of(frames: Iterable[Frame]) -> Correspondences:
    """The table of points: targets that both photographs of a used frame show."""
    frames = sorted(frames, key=lambda frame: frame.frame)
    seen = [
        # The source is the less automatic one of both.
        (frame.frame, target, first, second, max(first.source, second.source, key=SOURCES.index))
        for frame in frames
        if frame.use
        for target in (0, 1)
        if (first := frame.centres[0][target]) and (second := frame.centres[1][target])
    ]
    if not seen:
        why = next((f" The first: {report_line(frame)}" for frame in frames if frame.reason), "")
        raise StereocalError(f"No target is seen by both cameras in any frame that is used.{why}")
    numbers, targets, primary, secondary, sources = zip(*seen, strict=True)
    return Correspondences.from_arrays(
        frame=numbers,
        target=[TARGETS[target] for target in targets],
        primary=[(one.u, one.v) for one in primary],
        secondary=[(one.u, one.v) for one in secondary],
        sigma_primary_px=np.array([one.sigma_px for one in primary], np.float64),
        sigma_secondary_px=np.array([one.sigma_px for one in secondary], np.float64),
        source=sources,
    )


def pack_frames(frames: Sequence[Frame]) -> bytes:
    """The frames as JSON, read back exactly by `unpack_frames`."""
    content = {"format": FRAMES_FORMAT, "frames": [asdict(frame) for frame in frames]}
    return json.dumps(content, indent=1, allow_nan=False).encode()


def unpack_frames(content: bytes) -> list[Frame]:
    """The frames of `pack_frames`."""
    with damaged("The found targets cannot be read; find them again.", keep=True):
        data = json.loads(content)
        if data["format"] != FRAMES_FORMAT:
            raise StereocalError("The found targets were written by another version of stereocal.")
        return [frame_from_json(item) for item in data["frames"]]


def describe_frames(frames: Sequence[Frame]) -> str:
    """A sentence with the numbers of found, doubtful, refused and used frames."""
    counts = ", ".join(
        f"{sum(frame.state == state for frame in frames):,} {state}" for state in STATES
    )
    used = [frame for frame in frames if frame.use]
    bars = sum(len(frame.targets_in_both) == 2 for frame in used)
    both = f"{bars:,} of them with both targets"
    are = "is" if len(used) == 1 else "are"
    return f"{count(len(frames), 'frame')}: {counts}. {len(used):,} {are} used, {both}."


def report_line(frame: Frame) -> str:
    """One frame in a line: number, state, largest standard error, reason."""
    sigmas = [c.sigma_px for pair in frame.centres for c in pair if c and c.sigma_px is not None]
    shown = f", sigma at most {max(sigmas):.3f} px" if sigmas else ""
    reason = f": {frame.reason}" if frame.reason else ""
    return f"frame {frame.frame}: {frame.state}{shown}{reason}"


def name_in(camera: int, frame: Frame) -> str:
    """A photograph's name and camera, for messages."""
    return f"{frame.files[camera]} ({CAMERAS[camera]})"


def frame_from_json(item: Mapping[str, Any]) -> Frame:
    """The frame of a stored mapping; ValueError if it is damaged."""
    frame = of_plain(item, Frame)
    sound = abs(frame.frame) <= LARGEST_WHOLE and all(
        map(can_be_shown, (*frame.files, frame.reason))
    )
    for one in (centre for pair in frame.centres for centre in pair if centre):
        numbers = [abs(one.u), abs(one.v), 1.0 if one.sigma_px is None else one.sigma_px]
        # NaN is not below anything.
        sound &= one.source in SOURCES and all(0 <= number < LARGEST_PX for number in numbers)
    if not sound:
        raise ValueError(item)
    return frame
