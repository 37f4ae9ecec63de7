"""Put a data set together from the files of other programs.

found = gather({"calib_easyWandData.mat": content}, ExchangeOptions(cameras=("1", "3")))
found = gather({"wand.csv": ..., "camchain.yaml": ...}, ExchangeOptions())
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import Archive, baseline_taken, lens_taken, points_taken
from stereocal.formats.archives.bars import Bars, bars_of
from stereocal.formats.archives.easywand import open_easywand, read_easywand
from stereocal.formats.correspondences_csv import REQUIRED, read_table
from stereocal.formats.exchange.exchange import format_of, read_camera_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.reading import has_cameras
from stereocal.formats.matlab_file import SAVE_AGAIN
from stereocal.formats.other_files import is_hdf5, is_matlab
from stereocal.formats.point_layouts import first_rows, propose_layout
from stereocal.rig.camera import CAMERAS

TABLES = (".csv", ".txt", ".tsv")
WANTED = (
    "expected are one easyWandData.mat, or a table of the bar's ends (Argus, easyWand or DLTdv "
    "CSV) with camera files (Kalibr, ROS, OpenCV, MATLAB, aniposelib, Caliscope or stereocal)"
)


def gather(
    files: Mapping[str, bytes], options: ExchangeOptions, baseline_known: bool = False
) -> Archive:
    """What the files contribute to a data set, with a report.

    Args:
        files: contents by name.
        baseline_known: whether the user states the baseline, so that the unit of the files'
            own need not be known.
    """
    tables = {name: each for name, each in files.items() if name.lower().endswith(TABLES)}
    others = {name: each for name, each in files.items() if name not in tables}
    for name, content in others.items():
        _check_known(name, content)
        opened = open_easywand(content, name) if is_matlab(content) else None
        if opened is None:
            continue
        if len(files) > 1:
            raise StereocalError(f"{name}: it has points and lenses; give it alone.")
        return read_easywand(opened, options)
    if len(tables) > 1:
        raise StereocalError(f"{', '.join(tables)}: these are {len(tables)} tables; give one.")
    found = Archive(())
    if others:
        found = _with_cameras(found, others, options, baseline_known)
    if tables:
        ((name, content),) = tables.items()
        found = _with_table(found, name, content, options)
    return found


def _check_known(name: str, content: bytes) -> None:
    """Raise a `StereocalError` for a file that is of no known kind."""
    if is_hdf5(content):
        raise StereocalError(
            f"{name}: this is an HDF5 file, as MATLAB saves with -v7.3; it is not read here. "
            f"{SAVE_AGAIN}."
        )
    if format_of(name, content) is None:
        raise StereocalError(f"{name}: the file is not known; {WANTED}.")


def _with_cameras(
    found: Archive, files: Mapping[str, bytes], options: ExchangeOptions, baseline_known: bool
) -> Archive:
    pair = read_camera_pair(files, options)
    source = ", ".join(files)
    origin = f"{source} ({', '.join(filter(None, (pair.program, pair.words)))})"
    taken = [
        lens_taken(which, camera, origin)
        for which, camera in zip(CAMERAS, (pair.primary, pair.secondary), strict=True)
    ]
    baseline = None if pair.pose is None or baseline_known else pair.pose.baseline
    if baseline is not None:
        baseline *= pair.scale(baseline, options.unit, source)
        taken.append(baseline_taken(baseline, f"{source}, its own solution"))
    return replace(
        found,
        taken=(*found.taken, *taken),
        primary=pair.primary,
        secondary=pair.secondary,
        baseline_m=baseline,
        notes=(*found.notes, f"Lenses from {origin}."),
        remarks=found.remarks + (pair.chosen.remarks if pair.chosen else ()),
    )


def _with_table(found: Archive, name: str, content: bytes, options: ExchangeOptions) -> Archive:
    head, _ = first_rows(content, name)
    if set(REQUIRED) <= {cell.strip().lower() for cell in head[0]}:
        read = Bars(read_table(content, name).strict(name), "stereocal")
    else:
        read = _bars(found, name, content, options)
    return replace(
        found,
        taken=(points_taken(read.rows, f"{name} ({read.words})"), *found.taken),
        correspondences=read.rows,
        notes=(*found.notes, f"Points from {name}, {read.words}."),
        remarks=(*found.remarks, *read.remarks),
    )


def _bars(found: Archive, name: str, content: bytes, options: ExchangeOptions) -> Bars:
    """The bars of another program's table, in images of the stated or the cameras' height."""
    sizes = [
        size or (None if camera is None else camera.image_size)
        for size, camera in zip(options.image_sizes, (found.primary, found.secondary), strict=True)
    ]
    first, second = (None if size is None else size[1] for size in sizes)
    cameras = propose_layout(content, name, options.layout).cameras
    wanted = options.cameras
    # Of a table with two cameras, the choice may be about the camera files alone.
    if wanted and len(cameras) == 2 and found.primary and not has_cameras(cameras, wanted):
        read = bars_of(content, name, replace(options, cameras=None), (first, second))
        remark = (
            f"The two cameras of {name} are primary and secondary; --cameras was used for the "
            "camera files only."
        )
        return replace(read, remarks=(remark, *read.remarks))
    return bars_of(content, name, options, (first, second))
