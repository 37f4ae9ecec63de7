"""`stereocal reproduce`: the parameter files of an archive, computed again and compared."""

import argparse

from stereocal.commands.calibrate import validate
from stereocal.commands.console import Options
from stereocal.commands.options import finish
from stereocal.commands.warming import compile_all
from stereocal.paper_kit.reproduction import (
    FileComparison,
    ReproducibleResult,
    compare,
    processor_kind,
    read_archive,
)
from stereocal.rig.parameters import RigParameters
from stereocal.rig.result_file import software_versions
from stereocal.system.numbers import plural
from stereocal.workflow import Run

DIFFERENT = 1
"""Exit status if a file differs by more than its tolerance."""
MOST_SHOWN = 5
EPILOG = (
    "Exit status: 0 if all files are identical or within the tolerance, 1 if one differs, "
    "2 for bad input."
)
OPTIONS: Options = {
    "archive": "a paper kit, its archive.zip, or a project's zip",
    "--out OUT": "folder for the files",
}


def run(parsed: argparse.Namespace) -> int:
    """Compute the files again, write them, and print how each compares; the exit status."""
    archived = read_archive(parsed.archive)
    compile_all()
    sets = _computed_again(archived)
    files = {name: rig.dumps().encode() for name, rig in sets.items()}
    found = compare(archived, sets)
    others = [] if all(one.identical for one in found) else [_elsewhere(archived)]
    finish(parsed.out, files, *map(_line_of, found), *others)
    return 0 if all(one.agrees for one in found) else DIFFERENT


def _computed_again(archived: ReproducibleResult) -> dict[str, RigParameters]:
    """The parameter files by name, without those that cannot be computed any more."""
    found = Run(archived.dataset, archived.calibration, archived.refined)
    sets = (found if archived.validation is None else validate(found, archived.validation)).sets
    methods = {name: content["method"] for name, content in archived.files.items()}
    return {name: sets[method] for name, method in methods.items() if method in sets}


def _line_of(found: FileComparison) -> str:
    if found.identical:
        return f"{found.name}: identical (SHA-256 {found.digest})"
    if found.agrees:
        return f"{found.name}: within the tolerance ({found.tolerance})"
    count = len(found.differences)
    values = f"{count} {plural(count, 'value')}"
    head = f"{found.name}: different, in {values} beyond the tolerance ({found.tolerance}):"
    shown, more = [f"  {one}" for one in found.differences[:MOST_SHOWN]], count - MOST_SHOWN
    return "\n".join([head, *shown, *([f"  and {more} more"] if more > 0 else [])])


def _elsewhere(archived: ReproducibleResult) -> str:
    """Whether versions and processor are those of the archive."""
    then = {**archived.software, **archived.processor}
    now = {**software_versions(), **processor_kind()}
    changed = [
        f"{name} {before} there, {now.get(name, 'none')} here"
        for name, before in then.items()
        if now.get(name) != before
    ]
    if changed:
        return f"Not the same versions and processor: {'; '.join(changed)}."
    return "Versions and processor are those of the archive."
