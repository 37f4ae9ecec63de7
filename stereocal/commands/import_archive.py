"""`stereocal import`: a data set from the files of other programs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

from stereocal.commands.console import Options, report
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
from stereocal.formats.archives.archive import THROW, Archive, Taken
from stereocal.formats.archives.every_camera import ENDS, gather_all
from stereocal.formats.archives.gather import WANTED, gather
from stereocal.formats.dataset_files import FREE, pack_dataset
from stereocal.formats.exchange.options import ORIGIN, ExchangeOptions
from stereocal.formats.point_layouts import LAYOUTS
from stereocal.formats.recording_files import pack_recording
from stereocal.rig.dataset import Dataset
from stereocal.system.atomic_files import write_all
from stereocal.system.numbers import rounded

EVERY = "all"
BAR_LAYOUTS = tuple(name for name in LAYOUTS if name in ("wand", "argus", "dltdv5", "dltdv8"))


OPTIONS: Options = {
    "files FILE...": WANTED,
    "--out OUT": "folder of the data set",
    "--cameras P,S": "primary and secondary camera: 1,2 or names (default: 1,2); all: a data set "
    "of every camera, for rig",
    **questions("unit"),
    "--baseline B": f"measured baseline in m; {FREE}: none, the lengths of the bars give the scale",
    "--distance D": "measured distance between A and B in m",
    "--image-size WxH": "of both cameras, if wrong or missing in the files",
    "--layout": {
        "type": str.lower,
        "choices": BAR_LAYOUTS,
        "help": "which program wrote the table",
    },
    **questions(*ORIGIN),
    **LENSES_AND_LENGTHS,
}


def run(parsed: argparse.Namespace) -> None:
    """Read the files, write the data set, print what was taken and what is missing."""
    if parsed.cameras == EVERY:
        _import_every(parsed)
        return
    baseline = _baseline(parsed.baseline)
    size = image_size(parsed.image_size)
    found = gather(
        contents(parsed.files),
        ExchangeOptions(
            image_sizes=(size, size),
            cameras=None if parsed.cameras is None else two_cameras(parsed.cameras),
            layout=parsed.layout,
            **answers(parsed),
        ),
        baseline_known=baseline is not None,
    )
    missing = found.missing(baseline, parsed.distance)
    lines = [*_not_replaced(found, baseline, parsed.distance), *missing]
    print(table_of(lines))
    dataset = with_sigmas(found.dataset(parsed.out.name, baseline, parsed.distance), parsed)
    files = {parsed.out / name: content for name, content in pack_dataset(dataset).items()}
    if found.throw is not None:
        files[parsed.out / THROW] = found.throw.to_csv(index=False, lineterminator="\n").encode()
    write_all(files)
    report(notes=notes_on(found, dataset), written=[parsed.out])


def _import_every(parsed: argparse.Namespace) -> None:
    """The same of all cameras: a data set of format 2."""
    size = image_size(parsed.image_size)
    options = ExchangeOptions(image_sizes=(size, size), layout=parsed.layout, **answers(parsed))
    lengths = {} if parsed.distance is None else {ENDS[1]: parsed.distance}
    found = gather_all(contents(parsed.files), options, parsed.out.name, lengths)
    print(table_of(found.taken))
    packed = pack_recording(found.recording)
    write_all({parsed.out / name: content for name, content in packed.items()})
    report(notes=found.remarks, written=[parsed.out])


def table_of(lines: Sequence[Taken]) -> str:
    """The report as a table."""
    rows = [("what", "taken", "from"), *((t.what, t.taken, t.origin) for t in lines)]
    widths = [max(len(row[k]) for row in rows) for k in (0, 1)]
    return "\n".join(f"{a:<{widths[0]}}  {b:<{widths[1]}}  {c}" for a, b, c in rows)


def notes_on(found: Archive, dataset: Dataset) -> list[str]:
    """What to know about the data set."""
    notes = list(found.remarks)
    if found.baseline_m is not None and dataset.baseline_m == found.baseline_m:
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


def _baseline(text: str | None) -> float | None:
    """The stated baseline; infinite if it is free, None if it is not stated."""
    if text is None or text == FREE:
        return None if text is None else math.inf
    try:
        return float(text)
    except ValueError:
        raise StereocalError(
            f'--baseline is "{text}"; it must be a length in metres, or {FREE}.'
        ) from None


def _not_replaced(found: Archive, baseline: float | None, distance: float | None) -> list[Taken]:
    """The report without what the options replace, and with the options."""
    lines = [
        line
        for line in found.taken
        if not (line.what == "baseline" and baseline is not None)
        and not (line.what == "distance A-B" and distance is not None)
    ]
    if distance is not None:
        lines.append(Taken("distance A-B", f"{distance:g} m", "--distance"))
    if baseline is not None:
        free = math.isinf(baseline)
        words = "free: the lengths of the bars give the scale" if free else f"{baseline:g} m"
        lines.append(Taken("baseline", words, "--baseline"))
    return lines
