"""Read point files of tracking programs by a layout of their columns.

    layout = propose_layout(content, "xypts.csv")     # to be checked and corrected
    table = read_points(content, layout, "cam1", image_height=1024, source="xypts.csv")

A layout is proposed from the header. `questions` are for the user, on what the file does not state
(the pixel origin, which cameras to use).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import PixelOrigin
from stereocal.frames.pairing import natural
from stereocal.rig.correspondences import TARGETS, Correspondences
from stereocal.rig.recording import Recording
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.csv_text import as_names, without_apostrophes
from stereocal.system.dialect import Dialect, head_of
from stereocal.system.limits import Limits
from stereocal.system.names import JoinedNames
from stereocal.system.numbers import is_number
from stereocal.system.tables import (
    LARGEST_INTEGER,
    MISSING,
    Column,
    Rows,
    numbers_in,
    numbers_of,
    refuse_thousands,
    rows_below,
    text_of,
)

_TIME = re.compile(
    r"(?<![^\W_])(t|times?|(time[ _]?)?stamps?|zeit|temps|tiempo|tempo|s|sec|seconds?|ms)"
    r"(?![^\W_])",
    re.IGNORECASE,
)
SAME_STEP = 0.25
"""Part of a frame by which a time may be off that of the frame."""
MOST_NAMES = 1_000
"""Most names of cameras, or of points, that a column may have."""


@dataclass(frozen=True)
class PointColumns:
    """Column indices, from 0, of one point in one camera."""

    camera: str
    point: str
    u: int
    v: int
    likelihood: int | None = None
    """Column with the tracker's likelihood, if there is one."""


@dataclass(frozen=True)
class PointLayout:
    """Meaning of the columns of a point file."""

    program: str
    """Program that writes such files, for messages."""
    columns: tuple[PointColumns, ...]
    header_rows: int = 1
    dialect: Dialect = field(default_factory=Dialect)
    frame: int | None = None
    """Column of the frame number; None: rows are counted from 1."""
    further: tuple[tuple[str, int], ...] = ()
    """Names and indices of columns that are passed through."""
    origin: PixelOrigin = field(default_factory=PixelOrigin)
    px_per_unit: float = 1.0
    least_likelihood: float = 0.0
    """Less likely points count as missing."""
    zero_is_missing: bool = False
    """Whether (0, 0) marks a missing point."""
    questions: tuple[str, ...] = ()
    camera_column: int | None = None
    point_column: int | None = None
    """Columns with the name of the camera and of the point; None: `columns` name them."""
    names: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    """The names in these two columns."""
    points_by_camera: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """The names of points that each camera has, where both columns are there."""
    roles: str | None = None
    """What each column holds, as of `column_roles`; None: as the program writes it."""
    titles: tuple[str, ...] = ()
    width: int | None = None
    """Its columns, if more are empty; None: all."""
    only: tuple[int, str] | None = None
    """A column, and how its cells begin, in lower case, in rows that count, if there are such."""
    times: tuple[float, float] | None = None
    """Of frame 0 and between frames, where the frame column has times; None: it has frames."""
    alike: Mapping[str, str] = field(default_factory=dict)
    """Other spellings of names in the column of points."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras, in the file's order."""
        if self.camera_column is not None:
            return self.names[0]
        return tuple(dict.fromkeys(point.camera for point in self.columns))

    @property
    def states_cameras(self) -> bool:
        """Whether the names of the cameras are the file's own, and not counted."""
        return self.header_rows > 0

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points, in the file's order."""
        if self.point_column is not None:
            return self.names[1]
        return tuple(dict.fromkeys(point.point for point in self.columns))


def read_points(
    content: bytes,
    layout: PointLayout,
    camera: str,
    image_height: int | None = None,
    source: str = "points",
    first_rows: int | None = None,
) -> pd.DataFrame:
    """The points of one camera: `frame,u,v`, `point` if there are several, and further columns.

    Pixels are stereocal's: the centre of the top-left pixel is (0, 0). Missing points are left out.

    Args:
        image_height: rows of the image; required if the file's origin is at the lower left.
        first_rows: read only this number of rows, for a preview.
    """
    rows = _Rows(_table(content, layout, source, first_rows), layout, source)
    points = rows.points(camera, image_height)
    return points if len(layout.points) > 1 else points.drop(columns="point")


def points_of_all(
    content: bytes, layout: PointLayout, image_height: int | None, source: str
) -> pd.DataFrame:
    """The points of all cameras, as the table of a data set of format 2."""
    layout, _, _ = with_joined_names(layout)
    layout = replace(layout, times=times_in(content, layout, source))
    rows = _Rows(_table(content, layout, source, None), layout, source)
    tables = [rows.points(name, image_height).assign(camera=name) for name in layout.cameras]
    table = pd.concat(tables).rename(columns={"point": "target"})
    return table[["frame", "camera", "target", "u", "v"]]


def with_words(content: bytes, layout: PointLayout, source: str) -> PointLayout:
    """The layout with the names of cameras, as they come or by number, and of points, sorted, where
    columns have them."""
    raw = _table(content, layout, source, None)
    words = [
        None if k is None else as_names(raw[k]) for k in (layout.camera_column, layout.point_column)
    ]
    names = [
        () if column is None else tuple(str(name) for name in column.unique() if name)
        for column in words
    ]
    if (most := max(map(len, names))) > MOST_NAMES:
        raise StereocalError(f"{source}: a column with {most} different values names no points.")
    # Numbers by which the user chooses cameras are then their names too.
    cameras = sorted(names[0], key=int) if all(map(str.isdecimal, names[0])) else names[0]
    points = tuple(sorted(names[1], key=lambda name: (len(name), name)))
    by_camera = dict[str, tuple[str, ...]]()
    if words[0] is not None and words[1] is not None:
        points_of = words[1].groupby(words[0]).unique()
        by_camera = {camera: tuple(points_of[camera]) for camera in cameras}
    return replace(layout, names=(tuple(cameras), points), points_by_camera=by_camera)


def times_in(content: bytes, layout: PointLayout, source: str) -> tuple[float, float] | None:
    """The first time and that between frames where the frame column has times with decimals."""
    column = layout.frame
    if column is None or _TIME.search("".join(layout.titles[column : column + 1])) is None:
        return None
    cells = _table(content, layout, source, None)[column]
    times = np.unique(numbers_of(cells, layout.dialect.decimal_comma))
    if len(times) < 2 or not np.isfinite(times).all() or (times == np.round(times)).all():
        return None
    steps = np.diff(times)
    usual, least = (
        float(steps.sum() / max(np.round(steps / step).sum(), 1.0))
        for step in (np.median(steps), steps.min())
    )
    frames = (times - times[0]) / least
    is_raster = bool((np.abs(frames - np.round(frames)) <= SAME_STEP).all())
    return float(times[0]), least if is_raster else usual


def with_joined_names(layout: PointLayout) -> tuple[PointLayout, tuple[str, ...], tuple[str, ...]]:
    """The layout with one spelling of the names of points, as of `JoinedNames` for the cameras;
    those that one camera has; and remarks."""
    by_camera = layout.points_by_camera
    if layout.point_column is None:
        by_camera = {
            camera: tuple(column.point for column in layout.columns if column.camera == camera)
            for camera in layout.cameras
        }
    elif layout.camera_column is None:
        return layout, (), ()
    joined = JoinedNames.of([*by_camera.values()])
    points = tuple(dict.fromkeys(joined.alike.get(name, name) for name in layout.points))
    columns = layout.columns
    if layout.point_column is None:
        columns = tuple(replace(c, point=joined.alike.get(c.point, c.point)) for c in columns)
    names = layout.names[0], points
    layout = replace(layout, columns=columns, names=names, alike=joined.alike)
    return layout, joined.alone, tuple(filter(None, [joined.in_words(by_camera)]))


@dataclass(frozen=True, eq=False)
class BarPoints:
    """Ends of a bar in some frames, as any number of cameras saw them."""

    frame: IntArray
    target: IntArray
    pixels: FloatArray
    """(n, cameras, 2): ours; NaN where a camera did not see it."""

    @property
    def seen(self) -> BoolArray:
        """(n, cameras)."""
        return np.asarray(np.isfinite(self.pixels).all(axis=2))

    def seen_by_two(self) -> "BarPoints":
        """Those that two cameras saw, or more."""
        rows = self.seen.sum(axis=1) >= 2
        return BarPoints(self.frame[rows], self.target[rows], self.pixels[rows])

    def put_into(self, recording: Recording) -> Recording:
        """The recording of these cameras and of the bar, with these points."""
        row, camera = np.nonzero(self.seen)
        order = np.lexsort([self.target[row], camera, self.frame[row]])
        row, camera = row[order], camera[order]
        with_points = replace(
            recording,
            frame=self.frame[row],
            camera=camera,
            target=self.target[row],
            points=self.pixels[row, camera],
            sigma_px=np.full(len(row), np.nan),
        )
        with_points.refuse_points_outside()
        return with_points.within_view()

    @property
    def correspondences(self) -> Correspondences:
        """The table of pairs, for two cameras."""
        both = self.seen_by_two()
        names = [TARGETS[target] for target in both.target]
        return Correspondences.from_arrays(both.frame, names, both.pixels[:, 0], both.pixels[:, 1])


def read_bars(
    content: bytes,
    layout: PointLayout,
    cameras: Sequence[str],
    ends: tuple[str, str],
    image_heights: Sequence[int | None],
    source: str = "points",
) -> BarPoints:
    """The ends of a bar that some camera saw.

    Args:
        cameras: their names, the primary first.
        ends: names of the points A and B.
    """
    rows = _Rows(_table(content, layout, source, None), layout, source)
    for end in ends:
        if end not in layout.points:
            raise StereocalError(f"{source}: there is no point {end}.")
    tables = []
    for camera, height in zip(cameras, image_heights, strict=True):
        points = rows.points(camera, height)
        points = points[points["point"].isin(ends)]
        twice = points[points.duplicated(["frame", "point"])]
        if len(twice):
            frame, point = twice.iloc[0][["frame", "point"]]
            raise StereocalError(
                f"{source}: frame {frame} has the point {point} of camera {camera} twice."
            )
        tables.append(points.set_index(["point", "frame"])[["u", "v"]].add_suffix(f" {camera}"))
    seen = pd.concat(tables, axis=1).reset_index()
    number = {end: k for k, end in enumerate(ends)}
    target = np.asarray(seen["point"].map(number), dtype=np.int64)
    frames = np.asarray(seen["frame"], dtype=np.int64)
    order = np.lexsort([frames, target])
    pixels = seen.iloc[:, 2:].to_numpy(dtype=np.float64).reshape(-1, len(cameras), 2)
    return BarPoints(frames[order], target[order], pixels[order])


def _table(
    content: bytes, layout: PointLayout, source: str, first_rows: int | None
) -> pd.DataFrame:
    """The rows below the header, all as text, with their lines as index."""
    text = text_of(content, source)
    Limits.from_environment().check_rows(text.count("\n"), source)
    cells = layout.dialect.cells("".join(head_of(text)[layout.dialect.above :]), source)
    below = [len(row) for row in cells[layout.header_rows :] if any(row)]
    named = max((len(row) for row in cells[: layout.header_rows]), default=max(below, default=0))
    named = layout.width or named
    raw, problems = rows_below(text, layout.dialect, layout.header_rows, named, source, first_rows)
    Rows(raw, {}, {}, problems).check(source)
    pixels = [k for point in layout.columns for k in (point.u, point.v)]
    wanted = [layout.frame, layout.camera_column, layout.point_column, *pixels]
    wanted += [point.likelihood for point in layout.columns]
    wanted += [index for _, index in layout.further]
    last = max(index for index in wanted if index is not None)
    width = min(named, below[0] if below else named)
    if width <= last:
        raise StereocalError(
            f"{source}: the layout ({layout.program}) needs {last + 1} columns; the file has "
            f"{width}."
        )
    if layout.only is not None:
        kept = raw[layout.only[0]].str.strip().str.lower().str.startswith(layout.only[1])
        raw = raw[kept] if kept.any() else raw
    values = [numbers_of(raw[k], layout.dialect.decimal_comma) for k in pixels]
    titles = [_named(k, layout) for k in pixels]
    refuse_thousands(raw, pixels, values, titles, source)
    return raw


def _named(index: int, layout: PointLayout) -> str:
    """A column, for messages."""
    titles = layout.titles[index : index + 1]
    return f"column {index + 1}" + "".join(f" ({title[:40]})" for title in titles if title)


@dataclass(frozen=True)
class _Rows:
    """The rows below the header, with their layout."""

    raw: pd.DataFrame
    layout: PointLayout
    source: str

    def points(self, camera: str, image_height: int | None) -> pd.DataFrame:
        """The points of one camera: `frame,u,v,point` and further columns, in order."""
        layout, raw = self.layout, self.raw
        by_column = layout.camera_column is not None
        chosen = [point for point in layout.columns if by_column or point.camera == camera]
        if not chosen or camera not in layout.cameras:
            raise StereocalError(
                f"{self.source}: there is no camera {camera}; the file has "
                f"{', '.join(layout.cameras)}."
            )
        of_camera = np.ones(len(raw), dtype=bool)
        if layout.camera_column is not None:
            of_camera = (as_names(raw[layout.camera_column]) == camera).to_numpy()
        frames, parts = self.frames(), []
        for point in chosen:
            pixels = self.pixels(point, image_height)
            part = pd.DataFrame({"frame": frames, "u": pixels[:, 0], "v": pixels[:, 1]})
            part["point"] = point.point
            if layout.point_column is not None:
                names = as_names(raw[layout.point_column])
                part["point"] = [layout.alike.get(name, name) for name in names]
            for name, index in layout.further:
                part[name] = without_apostrophes(raw[index]).array
            parts.append(part[np.isfinite(pixels).all(axis=1) & of_camera])
        return pd.concat(parts).sort_values("frame", kind="stable", ignore_index=True)

    def frames(self) -> IntArray:
        """(n,): their frame numbers; those in names of photographs, or their order.

        Raises:
            StereocalError: names of one camera's photographs have no numbers that tell them apart.
        """
        if self.layout.frame is None:
            return np.arange(1, len(self.raw) + 1)
        if self.layout.times is not None:
            first, step = self.layout.times
            return self._frames_at((self._numbers(self.layout.frame) - first) / step, step)
        texts = self.raw[self.layout.frame].str.strip()
        is_word = pd.to_numeric(texts, errors="coerce").isna()
        has_letters = texts[is_word].str.contains(r"[^\W\d_]", regex=True).any()
        # A word among numbers is no name: a line below the table, such as its mean.
        if self.layout.roles is None or not has_letters or not is_word.all():
            return self._numbers(self.layout.frame, is_whole=True).astype(np.int64)
        stems = texts.str.replace(r"\.[A-Za-z]{2,4}$", "", regex=True)
        in_names = [re.findall(r"\d{1,15}", stem) for stem in stems]
        for last in range(1, min(map(len, in_names), default=0) + 1):
            # `frame0042_cam1` and `f00042_1080p` have another number behind it.
            numbers = np.array([digits[-last] for digits in in_names], dtype=np.int64)
            if self._tells_apart(texts, numbers):
                return numbers
        if len(self.layout.cameras) < 2:
            raise StereocalError(
                f"{self.source}: the frames are called {texts.iloc[0][:40]}, ...: no number in "
                "these names tells them apart, so that those of the other camera cannot be found. "
                "Write the numbers of the frames."
            )
        known = {name: k for k, name in enumerate(sorted(texts.unique(), key=natural), 1)}
        return np.asarray(texts.map(known), dtype=np.int64)

    def _frames_at(self, times: FloatArray, step: float) -> IntArray:
        """(n,): the frames at times in frames, which are `step` apart.

        Raises:
            RefusedRowsError: names the times that are between two frames, or are none.
        """
        frames, cells = np.round(times), self.raw[self.layout.frame]
        reasons = {
            row: f'the time "{cells.iloc[row].strip()[:40]}" is not of frames {step:.6g} apart: '
            "write the numbers of the frames"
            for row in np.flatnonzero(~(np.abs(times - frames) <= SAME_STEP)).tolist()
        }
        Rows(self.raw, {}, reasons, []).check(self.source)
        return frames.astype(np.int64)

    def _tells_apart(self, texts: "pd.Series[str]", numbers: IntArray) -> bool:
        """Whether the photographs of a camera have different numbers."""
        camera = self.layout.camera_column
        photographs = pd.DataFrame({"text": texts, "number": numbers}, index=texts.index)
        photographs["camera"] = "" if camera is None else self.raw[camera].str.strip()
        return not photographs.drop_duplicates().duplicated(["camera", "number"]).any()

    def pixels(self, columns: PointColumns, image_height: int | None) -> FloatArray:
        """(n, 2): our pixels; NaN for missing points."""
        layout = self.layout
        if layout.origin.corner == "lower-left" and image_height is None:
            raise StereocalError(
                f"{self.source}: the points are counted from the lower left, so the image height "
                "is needed."
            )
        pixels = np.column_stack([self._numbers(k) for k in (columns.u, columns.v)])
        if layout.zero_is_missing:
            pixels[(pixels == 0).all(axis=1)] = np.nan
        if columns.likelihood is not None:
            pixels[self._numbers(columns.likelihood) < layout.least_likelihood] = np.nan
        pixels[np.isnan(pixels).any(axis=1)] = np.nan
        return layout.origin.to_ours(pixels * layout.px_per_unit, image_height or 0)

    def _numbers(self, index: int, is_whole: bool = False) -> FloatArray:
        name = _named(index, self.layout)
        column = Column(name, may_be_empty=not is_whole, is_whole=is_whole, most=LARGEST_INTEGER)
        cells = self.raw[[index]].set_axis([name], axis=1)
        values, reasons = numbers_in(cells, [column], self.layout.dialect.decimal_comma, MISSING)
        Rows(cells, values, reasons, []).check(self.source)
        return values[name]


def is_number_or_empty(text: str) -> bool:
    return not text.strip() or is_number(text)
