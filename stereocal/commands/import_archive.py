"""`stereocal import`: a data set from the files of other programs."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace

from stereocal.commands.console import Number, Options, report
from stereocal.commands.options import (
    LENSES_AND_LENGTHS,
    answers,
    contents,
    image_size,
    questions,
    two_cameras,
    with_sigmas,
)
from stereocal.errors import StereocalError
from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate, what_frames_tell
from stereocal.formats.archives.all_cameras import ENDS, gather_all
from stereocal.formats.archives.archive import THROW, Archive, Part
from stereocal.formats.archives.gather import WANTED, gather
from stereocal.formats.column_roles import ROLES_HELP
from stereocal.formats.dataset_description import FREE
from stereocal.formats.dataset_files import pack_dataset, pack_recording
from stereocal.formats.exchange.options import ORIGIN, ExchangeOptions
from stereocal.formats.point_layouts import LAYOUTS
from stereocal.formats.recognition import recognise
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.atomic_files import write_all
from stereocal.system.numbers import POSSIBLE_M, rounded
from stereocal.system.zip_files import is_zip, unzip

EVERY = "all"
OF_BARS = ("wand", "argus", "dltdv5", "dltdv8", "caliscope", "openlpt", "table")
"""Layouts of tables of the ends of bars."""

OPTIONS: Options = {
    "files FILE...": WANTED,
    "--out OUT": "folder of the data set",
    "--cameras P,S": "primary and secondary camera: 1,2 or names (default: 1,2); all: a data set "
    "of every camera, for rig",
    **questions("unit", "frames"),
    "--baseline B": {
        "type": Number(float, *POSSIBLE_M, FREE),
        "help": f"measured baseline in m; {FREE}: none, the lengths of the bars give the scale",
    },
    "--distance D": "measured distance between A and B in m",
    "--image-size WxH": "of both cameras, if missing in the files, or wrong in easyWand's",
    "--layout": {
        "type": str.lower,
        "choices": [name for name in LAYOUTS if name in OF_BARS],
        "help": "which program wrote the table",
    },
    "--roles ROLES": ROLES_HELP,
    **questions(*ORIGIN),
    **LENSES_AND_LENGTHS,
}


def run(parsed: argparse.Namespace) -> None:
    """Read the files, write the data set, print what was taken and what is missing."""
    size, name, distance = image_size(parsed.image_size), parsed.out.name, parsed.distance
    files_given: dict[str, bytes] = {}
    for file, content in contents(parsed.files).items():
        is_packed = is_zip(content) and recognise(file, content).kind == "zip"
        files_given |= unzip(content, file) if is_packed else {file: content}
    options = ExchangeOptions(
        (size, size), layout=parsed.layout, roles=parsed.roles, **answers(parsed)
    )
    if parsed.cameras == EVERY:
        lengths = {} if distance is None else {ENDS[1]: distance}
        every = gather_all(files_given, options, name, lengths)
        _show(every.taken)
        recording = every.recording
        doubt = _other_count(recording if every.is_long else None, options)
        recording = in_step(recording)
        files, notes = pack_recording(recording), [*every.remarks, *recording.step_notes, *doubt]
    else:
        baseline = math.inf if parsed.baseline == FREE else parsed.baseline
        if parsed.cameras is not None:
            options = replace(options, cameras=two_cameras(parsed.cameras))
        archive = gather(files_given, options, baseline_known=baseline is not None)
        no_length = archive.no_baseline and archive.target_distance_m is None
        if no_length and options.unit not in (None, "m"):
            raise StereocalError(
                "--unit is that of lengths in the files, which have none: state --baseline and "
                "--distance in metres."
            )
        stated = _not_replaced(archive, baseline, distance)
        _show([*stated, *archive.missing(baseline, distance)])
        recording = archive.recording(name, baseline, distance)
        counted = None if archive.counted is None else archive.counted.put_into(recording)
        doubt = _other_count(counted, options)
        dataset = with_sigmas(pair_to_calibrate(recording), parsed)
        files = pack_dataset(dataset)
        notes = [*_notes_on(archive, dataset), *dataset.recording.step_notes, *doubt]
        if archive.throw is not None:
            files[THROW] = archive.throw.to_csv(index=False, lineterminator="\n").encode()
    write_all({parsed.out / name: content for name, content in files.items()})
    report(notes=notes, written=[parsed.out])


def _other_count(recording: Recording | None, options: ExchangeOptions) -> list[str]:
    """A note if the points leave it open how the frames are counted, and nothing else says it.

    Args:
        recording: with all points of each camera; None: a row has those of all.

    Raises:
        StereocalError: the points say that each camera counts its own.
    """
    if recording is None or recording.own_frames or options.frames is not None:
        return []
    in_step, why = what_frames_tell(recording)
    if in_step is False:
        raise StereocalError(
            f"the cameras seem to have been started by hand. {why} State how their frames are "
            "counted.",
            option="--frames own, and they are brought into step; or common, to read them as they "
            "are numbered",
        )
    more = " If the cameras were started by hand, give --frames own; if not, --frames common."
    return [why + more] if why else []


def _show(lines: Sequence[Part]) -> None:
    """Print what was found and what is missing, as a table."""
    rows = [("what", "taken", "from"), *((t.what, t.taken, t.origin) for t in lines)]
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    report(*(f"{a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows))


def _notes_on(archive: Archive, dataset: Pair) -> list[str]:
    notes = list(archive.remarks)
    if archive.baseline_m is not None and dataset.baseline_m == archive.baseline_m:
        notes.append(
            f"The baseline of {rounded(dataset.baseline_m, 4)} m is the other program's result, "
            "not a measurement. If you have measured it, give --baseline B; else --baseline free "
            "lets the lengths alone give the scale."
        )
    if dataset.baseline_is_free:
        notes.append(
            f"The lengths of the bars give a baseline of {rounded(dataset.baseline_m, 4)} m."
        )
    return notes


def _not_replaced(archive: Archive, baseline: float | None, distance: float | None) -> list[Part]:
    """The report without what the options replace, and with the options."""
    stated = []
    if distance is not None:
        stated.append(Part("distance A-B", f"{distance:g} m", "--distance"))
    if baseline is not None:
        free = math.isinf(baseline)
        words = "free: the lengths of the bars give the scale" if free else f"{baseline:g} m"
        stated.append(Part("baseline", words, "--baseline"))
    replaced = {line.what for line in stated}
    return [*(line for line in archive.taken if line.what not in replaced), *stated]
