"""Put a data set together from the files of other programs.

found = gather({"calib_easyWandData.mat": content}, ExchangeOptions(cameras=("1", "3")))
found = gather({"wand.csv": ..., "camchain.yaml": ...}, ExchangeOptions())
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import PurePath

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import Archive, baseline_taken, lens_taken, points_taken
from stereocal.formats.archives.easywand import EasyWandFile, open_easywand, read_easywand
from stereocal.formats.archives.several_tables import layout_of_table, one_table
from stereocal.formats.column_roles import counts_own, own_count_of
from stereocal.formats.correspondences_csv import REQUIRED, read_table
from stereocal.formats.exchange.chosen_cameras import Wanted, chosen_pair, has_cameras, namesakes
from stereocal.formats.exchange.exchange import (
    camera_names,
    format_of,
    holds_pose_alone,
    read_camera_pair,
    what_it_holds,
)
from stereocal.formats.exchange.options import Contents, ExchangeOptions
from stereocal.formats.matlab_file import SAVE_AGAIN
from stereocal.formats.other_files import is_hdf5, is_matlab
from stereocal.formats.point_answers import layout_by_hand, what_is_missing
from stereocal.formats.point_files import (
    BarPoints,
    PointLayout,
    read_bars,
    times_in,
    with_joined_names,
)
from stereocal.formats.point_layouts import first_rows
from stereocal.formats.point_text import point_text
from stereocal.formats.recognition import recognise
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import Correspondences

Heights = Sequence[int | None]
"""Heights of the images of the cameras, px."""
WANTED = (
    "expected are one easyWandData.mat, or a table of the bar's ends (Argus, easyWand or DLTdv "
    "CSV, or any other) with camera files (OpenCV, MATLAB, Kalibr, ROS, ZED, OAK and others)"
)
MIDDLES = ("middle", "mid", "centre", "center")
"""Names of points that are no end of a bar."""


def gather(files: Contents, options: ExchangeOptions, baseline_known: bool = False) -> Archive:
    """What the files contribute to a data set, with a report.

    Args:
        files: contents by name.
        baseline_known: whether the user states the baseline, so that the unit of the files'
            own need not be known.
    """
    files, options = with_one_table(files, options)
    table, others, opened = sorted_files(files)
    if opened is not None:
        return read_easywand(opened, options)
    of_table, named = table_cameras(files[table], table, options) if table else ((), False)
    of_files = names_in(others)
    wanted, remarks = _wanted(of_table, named, of_files, options.cameras)
    archive = Archive(())
    if others:
        for_files = replace(options, cameras=wanted[1])
        if for_files.cameras and all(len(camera_names(*file)) < 2 for file in others.items()):
            pair = chosen_pair(of_files, for_files.cameras, ", ".join(others)).pair
            names = [*others]
            others = {names[k]: others[names[k]] for k in pair}
        archive = _cameras(others, for_files, baseline_known)
    if table:
        archive = _with_table(archive, table, files[table], replace(options, cameras=wanted[0]))
    return replace(archive, remarks=(*remarks, *archive.remarks))


def table_cameras(
    content: bytes, name: str, options: ExchangeOptions
) -> tuple[tuple[str, ...], bool]:
    """The cameras in a table of points, and whether it states their names."""
    if _is_own(content, name, options):
        return CAMERAS, True
    layout = layout_of_table(content, name, options)
    return layout.cameras, layout.states_cameras


def names_in(files: Contents) -> tuple[str, ...]:
    """Names of the cameras in camera files: those in a file of several, or of the files of one."""
    names: list[str] = []
    for name, content in files.items():
        several = camera_names(name, content)
        alone = [] if holds_pose_alone(name, content) else [PurePath(name).stem]
        names += several if len(several) > 1 else alone
    return tuple(names)


def _wanted(
    of_table: tuple[str, ...], named: bool, of_files: tuple[str, ...], wanted: Wanted
) -> tuple[tuple[Wanted, Wanted], tuple[str, ...]]:
    """The cameras wanted of the table, those of the camera files, and remarks.

    A choice is looked for in both. Without one, lenses go to the points of the same name where the
    table states names that the files have, or else both are taken in their order.
    """
    if len(of_table) < 2 or len(of_files) < 2:
        return (wanted, wanted), ()
    if wanted is None:
        if len(of_table) > len(of_files):
            if named and (same_names := namesakes(of_files, of_table)):
                return ((same_names[0], same_names[1]), None), ()
            raise StereocalError(
                f"The table is read as the points of {len(of_table)} cameras, and the camera files "
                f"are of {len(of_files)}. Say which cameras they are. If the commas are decimal "
                "signs too, save the table with semicolons between its cells.",
                option="--cameras, as --cameras 1,3",
            )
        same = namesakes(of_table, of_files)[:2] if named else []
        if not same or same == [0, 1]:
            return (None, None), ()
        return (None, (same[0], same[1])), (
            f"The lenses of {of_table[0]} and {of_table[1]} are those that are called so.",
        )
    in_files, in_table = (has_cameras(cameras, wanted) for cameras in (of_files, of_table))
    if (
        (in_files or in_table)
        and len(of_table) == len(of_files)
        and not (named and namesakes(of_table, of_files))
    ):
        # The same cameras by other names: a choice by the names of one is about both.
        names = of_table if in_table and not in_files else of_files
        pair = chosen_pair(names, wanted, "the camera files").pair
        return (pair, pair), ()
    for k, names, other in ((0, of_table, "camera files"), (1, of_files, "table")):
        # The choice among three may be about the other alone.
        if len(names) == 2 and not has_cameras(names, wanted):
            return (None, wanted) if k == 0 else (wanted, None), (
                f"{names[0]} and {names[1]} are primary and secondary; --cameras was used for the "
                f"{other} only.",
            )
    return (wanted, wanted), ()


def sorted_files(files: Contents) -> tuple[str, dict[str, bytes], EasyWandFile | None]:
    """The name of the table, or empty, the camera files, and the file that has everything."""
    tables = [name for name, content in files.items() if is_table(name, content)]
    others = {name: content for name, content in files.items() if name not in tables}
    for name, content in others.items():
        if recognise(name, content).kind == "data set":
            raise StereocalError("this is a data set already: use it as it is.", name)
        if is_hdf5(content):
            raise StereocalError(
                f"{name}: this is an HDF5 file, as MATLAB saves with -v7.3; it is not read here. "
                f"{SAVE_AGAIN}."
            )
        if format_of(name, content) is None:
            holds = what_it_holds(name, content)
            problem = recognise(name, content).problem or f"it is not known{holds}; {WANTED}."
            raise StereocalError(problem, name)
        if is_matlab(content) and (opened := open_easywand(content, name)) is not None:
            if len(files) > 1:
                raise StereocalError(f"{name}: it has points and lenses; give it alone.")
            return "", {}, opened
    return "".join(tables), others, None


def with_one_table(files: Contents, options: ExchangeOptions) -> tuple[Contents, ExchangeOptions]:
    """The files, with their table as text, several as one, and the options that are about it."""
    tables = [name for name, content in files.items() if is_table(name, content)]
    files = {**files, **{name: point_text(files[name], name) for name in tables}}
    if len(tables) < 2:
        return files, options
    table = one_table({name: files[name] for name in tables}, options)
    others = {name: content for name, content in files.items() if name not in tables}
    return {**others, ", ".join(tables): table}, replace(options, layout=None, roles=None)


def is_table(name: str, content: bytes) -> bool:
    return recognise(name, content).kind == "table"


def _cameras(files: Contents, options: ExchangeOptions, baseline_known: bool) -> Archive:
    pair = read_camera_pair(files, options)
    source = ", ".join(files)
    pair_in_words = ", ".join(filter(None, (pair.program, pair.words)))
    lenses = zip(CAMERAS, (pair.primary, pair.secondary), pair.files or (source,) * 2, strict=True)
    taken = [lens_taken(which, lens, f"{file} ({pair_in_words})") for which, lens, file in lenses]
    baseline = None if pair.pose is None or baseline_known else pair.pose.baseline
    if baseline is not None:
        baseline *= pair.scale(baseline, options.unit, source)
        taken.append(baseline_taken(baseline, f"{source}, its own solution"))
    archive = Archive(tuple(taken), pair.primary, pair.secondary, baseline_m=baseline)
    lacks, notes = pair.no_pose * (pair.pose is None), (f"Lenses from {source} ({pair_in_words}).",)
    return replace(archive, no_baseline=lacks, notes=notes, remarks=pair.remarks)


def nominal_baseline(
    primary: bytes, secondary: bytes, names: tuple[str, str]
) -> tuple[float, float] | None:
    """The baseline that two camera files of one program state, and its standard error, in metres.

    None if they do not say how the cameras stand.
    """
    pairs = zip(CAMERAS, names, (primary, secondary), strict=True)
    files = {f"{which}/{name}": content for which, name, content in pairs}
    with suppress(StereocalError):
        archive = _cameras(files, ExchangeOptions(), baseline_known=False)
        if archive.baseline_m is not None and archive.baseline_sigma_m is not None:
            return archive.baseline_m, archive.baseline_sigma_m
    return None


def _with_table(archive: Archive, name: str, content: bytes, options: ExchangeOptions) -> Archive:
    """With the bars of a table, in images of the stated or the cameras' height."""
    if _is_own(content, name, options):
        bars = Bars(read_table(content, name).strict(name), "stereocal")
    else:
        cameras = zip(options.image_sizes, (archive.primary, archive.secondary), strict=True)
        sizes = [size or (camera.image_size if camera else None) for size, camera in cameras]
        heights = [None if size is None else size[1] for size in sizes]
        bars = bars_of(content, name, options, heights)
        bars.refuse_unseen(name)
    return replace(
        archive,
        taken=(points_taken(bars.rows, f"{name} ({bars.words})", bars.own), *archive.taken),
        correspondences=bars.rows,
        counted=bars.counted,
        own_frames=bars.own_frames,
        notes=(*archive.notes, f"Points from {name}, {bars.words}."),
        remarks=(*archive.remarks, *bars.remarks),
    )


def is_correspondences(content: bytes, name: str) -> bool:
    """Whether a table is `correspondences.csv`."""
    head, _ = first_rows(content, name)
    return set(REQUIRED) <= {cell.strip().lower() for cell in head[0]}


def _is_own(content: bytes, name: str, options: ExchangeOptions) -> bool:
    """Whether a table is `correspondences.csv` and is to be read as such."""
    return options.layout is options.roles is None and is_correspondences(content, name)


@dataclass(frozen=True, eq=False)
class Bars:
    """The rows of a table for two cameras, and how it was read."""

    rows: Correspondences
    words: str
    remarks: tuple[str, ...] = ()
    """For the user."""
    counted: BarPoints | None = None
    """All points of both cameras, where a row has those of one: its frames may be its own count."""
    own_frames: bool = False
    """Whether they are, so that `rows` are still to be found."""

    def refuse_unseen(self, source: str) -> None:
        """Raise an error if no end of the bar was seen by both cameras."""
        if not (len(self.rows) or self.own_frames):
            is_long = self.counted is not None
            raise StereocalError(
                f"no end of the bar was seen by both cameras{' in one frame' * is_long} "
                f"({self.words}). {' '.join(self.remarks)}".strip(),
                source,
                option="--frames own, if each camera counts its own since they were started by hand"
                * is_long,
            )

    @property
    def own(self) -> BarPoints | None:
        """The points of cameras that count their own frames."""
        return self.counted if self.own_frames else None


def bars_of(content: bytes, source: str, options: ExchangeOptions, heights: Heights) -> Bars:
    """The bars in a file, as two cameras saw them."""
    layout, ends, remarks = layout_of_bars(content, source, options)
    chosen = chosen_pair(layout.cameras, options.cameras, source)
    if layout.origin.corner == "lower-left" and None in heights:
        raise StereocalError(
            "the points are counted from the lower left, so the image height is needed: give the "
            "camera files, or the size of the images.",
            source,
            option="--image-size WxH",
        )
    layout, own_frames = counted_as(layout, source, options)
    bars = read_bars(content, layout, chosen.names, ends, heights, source)
    counted = bars if layout.camera_column is not None else None
    corner = layout.origin.corner.replace("-", " ")
    words = f"{layout.program}, {chosen.words}, counted from the {corner}"
    return Bars(bars.correspondences, words, chosen.remarks + remarks, counted, own_frames)


def counted_as(
    layout: PointLayout, source: str, options: ExchangeOptions
) -> tuple[PointLayout, bool]:
    """The layout with the column of the frames that the options mean, and whether these are each
    camera's own count."""
    own = own_count_of(layout)
    own_frames = counts_own(layout) if options.frames is None else options.frames == "own"
    if own_frames and layout.camera_column is None:
        raise StereocalError(
            "a row has the points of all cameras at one moment, so their frames are in step "
            "already. Cameras that count their own need a table each, or a column camera.",
            source,
        )
    return (replace(layout, frame=own) if own_frames and own is not None else layout), own_frames


def layout_of_bars(
    content: bytes, source: str, options: ExchangeOptions
) -> tuple[PointLayout, tuple[str, str], tuple[str, ...]]:
    """The layout of a table with both ends of a bar, the names of A and B, and remarks.

    The ends are the user's, or else the first two points, those called a middle left out.

    Raises:
        StereocalError: it has not both ends.
    """
    layout = layout_of_table(content, source, options)
    layout = replace(layout, times=times_in(content, layout, source))
    # By the roles of its columns: what the columns lack can be said.
    if layout.roles is not None and min(len(layout.cameras), len(layout.points)) < 2:
        by_hand = layout_by_hand(content, source)
        raise StereocalError(f"{source}: {what_is_missing(by_hand, content, source)}")
    if len(layout.points) < 2:
        raise StereocalError(
            f"a table with both ends of the bar is expected; this looks like {layout.program} with "
            f"the points {', '.join(layout.points)[:60]}.",
            source,
        )
    layout, alone, remarks = with_joined_names(layout)
    outer = [point for point in layout.points if point.lower() not in MIDDLES]
    outer.sort(key=lambda point: point in alone)
    first, second, *_ = outer if len(outer) > 1 else layout.points
    ends = options.ends or (first, second)
    if ends[0] == ends[1]:
        raise StereocalError(
            f"the ends A and B are the same point ({ends[0]}): choose two.", source
        )
    if layout.times is not None:
        step = f"{layout.times[1]:.6g}"
        remarks += (f"The frames are counted by their times, {step} apart.",)
    if len(layout.points) > 2 and options.ends is None:
        remarks += (
            f"There are {len(layout.points)} points; {ends[0]} and {ends[1]} were taken as the "
            "ends A and B of the bar.",
        )
    return replace(layout, origin=options.origin(layout.origin)), ends, remarks
