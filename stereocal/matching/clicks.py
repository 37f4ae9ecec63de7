"""Points that a person clicks in the images of two cameras or more, and what they measure: with the
parameters, threshold and noise of `match` and `reconstruct`, as they will be in `points.csv`.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from stereocal.fit.least_squares.small_steps import FACTOR
from stereocal.fit.rig_file import Parameters
from stereocal.matching.in_step import points_in_step
from stereocal.matching.point_noise import FEWEST_PAIRS
from stereocal.matching.point_table import POINT
from stereocal.matching.reconstruction import Measured, Points3D
from stereocal.matching.settled import Settled, Stated
from stereocal.matching.trajectories import TRACK
from stereocal.matching.views import points_of_names, views_of
from stereocal.rig.epipolar_curve import epipolar_curve
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.names import check_name
from stereocal.system.numbers import rounded, with_error

CLICK_PX = 1.0
"""Noise of a click, one standard deviation of a coordinate, until the points show their own: that
of the targets, which is taken of others, is not that of a hand."""
DRIFT_PX = 0.25
"""By how much a coordinate that is followed drifts from frame to frame, as a random walk: in the
sample flight 0.16 px after one frame, 0.40 after four, 0.74 after nine (root mean square of head
and tail in both videos, forwards and backwards, each from ten clicks)."""
STEP_PX = 0.05
"""Of derivatives by pixels."""
BY_HAND = Stated(usual_px=CLICK_PX, names=TRACK)
FEWEST = 2
"""Cameras that place a point; further ones improve it."""
Source = Literal["clicked", "snapped", "followed"]
Key = tuple[int, str, str]


@dataclass(frozen=True)
class Click:
    """A point in one image, in raw pixels."""

    frame: int
    camera: str
    track: str
    u: float
    v: float
    source: Source = "clicked"
    """`snapped` to what the image shows there; `followed` from another frame, and accepted."""
    origin: int | None = None
    """Frame of the click made by hand that one `followed` goes back to; earlier versions did not
    keep it."""

    def __post_init__(self) -> None:
        check_name("A track", self.track)

    @property
    def key(self) -> Key:
        """What a later click replaces."""
        return self.frame, self.camera, self.track


class Place(NamedTuple):
    """A point in space: of a track, in a frame."""

    track: str
    frame: int

    def __str__(self) -> str:
        return f"{self.track}, frame {self.frame}"


@dataclass(frozen=True)
class Clicks:
    """Points clicked in the images: each track has at most one in an image."""

    every: Mapping[Key, Click]

    @classmethod
    def of(cls, clicks: Iterable[Click]) -> "Clicks":
        """The clicks; of several at one place, the last is kept."""
        return cls({click.key: click for click in clicks})

    def placed(self, clicks: Iterable[Click]) -> "Clicks":
        """With further ones."""
        return Clicks.of([*self.every.values(), *clicks])

    def of_cameras(self, cameras: Iterable[str]) -> "Clicks":
        """Those in the images of these cameras."""
        wanted = {*cameras}
        return Clicks({key: click for key, click in self.every.items() if click.camera in wanted})

    @property
    def last_frame(self) -> int:
        """0 without clicks."""
        return max((click.frame for click in self.every.values()), default=0)

    @property
    def tracks(self) -> list[str]:
        """In the order of their first clicks."""
        return list(dict.fromkeys(click.track for click in self.every.values()))

    def along(self, track: str, camera: str) -> list[Click]:
        """Those of a track in one camera, by frame."""
        clicks = [e for e in self.every.values() if e.track == track and e.camera == camera]
        return sorted(clicks, key=lambda click: click.frame)

    @property
    def origins(self) -> dict[Key, int]:
        """The frame of the click made by hand whose error each has; where it was not kept, the last
        one before."""
        origins, last = dict[Key, int](), dict[tuple[str, str], int]()
        for key, click in sorted(self.every.items()):
            followed = click.source == "followed"
            last[key[1:]] = last.get(key[1:], click.frame) if followed else click.frame
            origins[key] = last[key[1:]] if click.origin is None else click.origin
        return origins

    @property
    def are_points(self) -> bool:
        """Whether any point is in the images of two cameras."""
        return max(Counter((f, t) for f, _, t in self.every).values(), default=0) >= FEWEST

    def tables(self, cameras: Iterable[str], to_match: bool = False) -> dict[str, pd.DataFrame]:
        """The points of each camera that has any: `frame,u,v,track,source`.

        Args:
            to_match: only tracks that two cameras have, so that no other two are taken for one.
        """
        columns = ["frame", *POINT, TRACK, "source"]
        rows = pd.DataFrame(map(vars, self.every.values()), columns=["camera", *columns])
        if to_match:
            rows = rows[rows.groupby(TRACK)["camera"].transform("nunique") >= FEWEST]
        by_camera = dict(iter(rows.sort_values(["frame", TRACK]).groupby("camera")))
        return {camera: by_camera[camera][columns] for camera in cameras if camera in by_camera}


class Length(NamedTuple):
    """A distance, or the mean of several."""

    metres: float
    sigma_m: float
    """Standard error, with that of the parameters."""
    frames: int = 1
    scale_m: float = 0.0
    """The part of the standard error that is the error of the bar, which all lengths share."""

    @property
    def mostly(self) -> str:
        """Which part of its error is the larger, if that is the bar."""
        if not 2 * self.scale_m**2 > self.sigma_m**2:
            return ""
        percent = rounded(100 * self.scale_m / self.metres)
        return f", most of the error from the bar, which is known to ± {percent} %"

    def __str__(self) -> str:
        return f"{with_error(self.metres, self.sigma_m)} m"


@dataclass(frozen=True, eq=False)
class ClickMeasure:
    """The parameters that match and measure, what is stated, and the world frame."""

    matching: Parameters
    measuring: Parameters
    """The same rig, where it is one of three cameras and more."""
    stated: Stated = BY_HAND
    world: Pose | None = None

    def settled(self, clicks: Clicks) -> Settled:
        """The noise and the threshold, as of the tables."""
        usual_px = self.stated.sigma_px or CLICK_PX
        tables, _ = self._in_step(clicks)
        return views_of(self.matching).settled_by_hand(tables, self.stated, usual_px)

    def measured(self, clicks: Clicks, settled: Settled) -> "MeasuredClicks":
        """What the points measure that two cameras or more have."""
        tables, timing = self._in_step(clicks)
        keys, columns = points_of_names(tables, self.matching.placed, (*POINT, "origin", "since"))
        places = [Place(track, int(frame)) for frame, track in keys]
        pixels, shared = columns[..., :2], columns[..., 2:]
        return MeasuredClicks(self, settled, places, pixels, shared, timing)

    def _in_step(self, clicks: Clicks) -> tuple[dict[str, pd.DataFrame], str]:
        """The points of each camera at the instants of the first's frames, and how."""
        tables, origins = clicks.tables(self.matching.placed, to_match=True), clicks.origins
        for camera, table in tables.items():
            names = zip(table["frame"].tolist(), table[TRACK].tolist(), strict=True)
            table["origin"] = [origins[frame, camera, track] for frame, track in names]
            table["since"] = table["frame"] - table["origin"]
        first, *others = self.matching.placed
        # Pictures are shown by common numbers.
        with_first = {first: next(iter(tables.values())).iloc[:0], **tables}
        in_step, done = points_in_step(self.matching, with_first, numbered_alike=True)
        named = {name: f"{name}: " * (len(others) > 1) for name in done}
        notes = [f"{named[name]}{note}" for name, sentences in done.items() for note in sentences]
        return {name: in_step[name] for name in tables}, " ".join(notes)

    def curve(self, click: Click, camera: str, velocity: FloatArray | None = None) -> FloatArray:
        """(n, 2): the epipolar line of a click in another image, by the set that matches.

        Args:
            velocity: (2,) of the point in its own image, px per frame: the other camera sees it
                later or earlier, by the time offset of the parameters.
        """
        both = [name for name in self.matching.placed if name in (click.camera, camera)]
        pixel, offset = np.array([click.u, click.v]), self.matching.pair(*both).time_offset
        if offset is not None and velocity is not None:
            later = float(offset.at([click.frame])[0])
            pixel += velocity * (later if click.camera == both[0] else -later)
        return epipolar_curve(self.matching, click.camera, camera, pixel)


@dataclass(frozen=True, eq=False)
class MeasuredClicks:
    """3D points of clicks, and distances between them."""

    how: ClickMeasure
    settled: Settled
    places: list[Place]
    pixels: FloatArray
    """(n, c, 2): NaN where a camera does not see a point."""
    shared: FloatArray
    """(n, c, 2): frame of the click made by hand whose error each pixel has, and frames since."""
    timing: str = ""
    """How the points of cameras after the first were brought into step."""

    @cached_property
    def fits(self) -> Measured:
        """Positions and their errors, as `reconstruct` has them."""
        return views_of(self.how.measuring).fit(self.pixels, self.settled.sigma_px)

    @cached_property
    def points(self) -> Points3D:
        """The points as they are in `points.csv`."""
        return self.fits.in_frame(self.how.world, self.how.measuring.volume, with_errors=True)

    @cached_property
    def errors_px(self) -> tuple[FloatArray, FloatArray]:
        """(n,) each: the reprojection errors, and the largest of clicks of one point."""
        return views_of(self.how.matching).errors_px(self.pixels, self.settled)

    @cached_property
    def click_px(self) -> float:
        """The noise of clicks made by hand: at least the usual one where it is not stated, and most
        points are followed from few, whose errors do not show it."""
        origins = np.nan_to_num(self.shared[..., 0]).tolist()
        points = {(place.track, *of) for place, of in zip(self.places, origins, strict=True)}
        is_known = len(points) >= min(FEWEST_PAIRS, len(self.places))
        if is_known or self.how.stated.sigma_px is not None:
            return self.settled.sigma_px
        return max(self.settled.sigma_px, CLICK_PX)

    @cached_property
    def rows(self) -> dict[Place, int]:
        """The row of each point that is in front of its cameras."""
        known = np.asarray(np.isfinite(self.fits.xyz).all(axis=1))
        return {place: row for row, place in enumerate(self.places) if known[row]}

    def sentence(self, place: Place) -> str:
        """Error, and position with its standard error, of one of `rows` in words."""
        row, points = self.rows[place], self.points
        assert points.sigma_m is not None  # the noise is settled
        numbers = zip("xyz", points.xyz[row].tolist(), points.sigma_m[row].tolist(), strict=True)
        where = ", ".join(f"{axis} {Length(value, sigma)}" for axis, value, sigma in numbers)
        outside = points.outside_volume is not None and bool(points.outside_volume[row])
        error_px, limit_px = (float(values[row]) for values in self.errors_px)
        fit = "below" if error_px <= limit_px else "above"
        doubt = "" if error_px <= limit_px else ": not the same point, or clicked badly"
        return (
            f"{rounded(error_px)} px, {fit} the threshold of {rounded(limit_px, 3)} px{doubt}. "
            f"{where}{', outside the volume of the calibration' * outside}."
        )

    def beyond(self, frame: int) -> set[str]:
        """The tracks whose point in a frame has an error above the threshold."""
        errors, limits = self.errors_px
        above = errors > limits
        return {
            place.track for place, row in self.rows.items() if place.frame == frame and above[row]
        }

    def in_words(self, *ends: tuple[Place, Place]) -> str:
        """The distance of two points, or the mean of several such, as a sentence; empty if none is
        measured."""
        if (length := self.length(*ends)) is None:
            return ""
        one, other = ends[0]
        if len(ends) > 1:
            of = f"{one.track} to {other.track}, mean of {length.frames} frames"
        else:
            of = f"{one} to {other}"
        return f"{of}: {length}{length.mostly}."

    def previous(self, place: Place) -> Place | None:
        """The point of the track in the nearest frame before."""
        before = [e for e in self.rows if e.track == place.track and e.frame < place.frame]
        return max(before, key=lambda place: place.frame, default=None)

    def common(self, one: str, other: str) -> list[tuple[Place, Place]]:
        """The points of two tracks in the frames that have both."""
        frames = sorted(place.frame for place in self.rows if place.track == one)
        both = [(Place(one, frame), Place(other, frame)) for frame in frames]
        return [ends for ends in both if ends[1] in self.rows]

    def length(self, *ends: tuple[Place, Place]) -> Length | None:
        """The distance of two points, or the mean of those of several pairs of points, with its
        error: that of the parameters is common to all.

        Clicks made by hand are independent, places followed from one of them are not. A distance
        within its own scatter has no direction to propagate errors along: its error is the root of
        the trace of the difference's covariance, which is that of the position, and for the mean of
        several an upper bound.
        """
        rows = [(self.rows[a], self.rows[b]) for a, b in ends if {a, b} <= {*self.rows}]
        if not rows or any(a == b for a, b in rows):
            return None
        (covariances, by_shared, shared), (one, other) = self.fits.errors, np.array(rows).T
        apart = self.fits.xyz[one] - self.fits.xyz[other]
        metres = np.linalg.norm(apart, axis=1)
        by_pixels, moved = covariances[one] + covariances[other], by_shared[one] - by_shared[other]
        of_both = by_pixels + moved @ shared @ moved.swapaxes(1, 2)
        scatter = np.sqrt(np.trace(of_both, axis1=1, axis2=2))
        far = metres > scatter
        along = apart[far] / metres[far, None]
        ends_of = np.concatenate([one[far], other[far]])
        variance = self._variance(ends_of, np.concatenate([along, -along]))
        sums = np.einsum("ni,niq->q", along, moved[far])
        sigma = np.sqrt(variance + sums @ shared @ sums) + scatter[~far].sum()
        scale = float(metres.mean() * np.sqrt(shared[FACTOR, FACTOR]))
        return Length(float(metres.mean()), float(sigma / len(rows)), len(rows), scale)

    def _variance(self, rows: IntArray, along: FloatArray) -> float:
        """Of the sum of points' coordinates along directions (k, 3), by the noise of their pixels:
        the error of a click is in all places followed from it, and what each adds in those after.

        Args:
            rows: (k,): which points.
        """
        views, pixels = views_of(self.how.measuring), self.pixels[rows]
        derivatives = np.empty_like(pixels)
        for index in np.ndindex(pixels.shape[1:]):
            step = np.zeros(pixels.shape[1:])
            step[index] = STEP_PX
            change = views.fit(pixels + step).xyz - self.fits.xyz[rows]
            derivatives[:, *index] = np.einsum("ni,ni->n", along, change) / STEP_PX
        k, camera = np.nonzero(np.isfinite(pixels[..., 0]))
        origin, since = self.shared[rows[k], camera].T
        track = [self.places[row].track for row in rows[k].tolist()]
        click = {"track": track, "camera": camera, "origin": origin}
        table = pd.DataFrame({**click, "back": since < 0, "since": np.abs(since)})
        table[[*POINT]] = derivatives[k, camera]
        of_clicks = table.groupby([*click])[[*POINT]].sum().to_numpy()
        chains = table.sort_values("since", ascending=False).groupby([*click, "back"])
        frames = chains["since"].diff(-1).fillna(table["since"]).to_numpy(np.float64)
        drifts = np.square(chains[[*POINT]].cumsum().to_numpy()).sum(axis=1) @ frames
        return float(self.click_px**2 * np.square(of_clicks).sum() + DRIFT_PX**2 * drifts)
