"""What a project holds: the one list by which it is stored, packed, opened and copied.

`Store` writes no value, file or result that is not on it. A zip has what does not stay; *Duplicate*
as well. `VACUUM INTO` copies the whole file: a job in it counts as interrupted, and what it had
found is used.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Literal

from stereocal.projects.inputs import Inputs
from stereocal.rig.camera import CAMERAS

Table = Literal["value", "named", "result", "edit", "file", "job", "found"]
INPUT, SETTING, FURTHER, CALIBRATED = "input", "setting", "dataset", "calibrated"
"""Parts of a project: inputs, form values, further data sets, the inputs of the last result."""
BAR, CLICKS = "bar", "clicks"
"""Photographs and how they are paired; points clicked in them."""
POINT_FILES, TABLES, ASKING = "points", "tables", "asking"
SETS, APPLIED, WORLD = "sets", "applied", "world"
"""Parts of the Apply page: uploaded point files, the tables read from them, and files with open
questions; parameter files, tables of the last result, and the world frame's file."""
CHECK = "check"
RECORDING, RIG_FILES = "recording", "rig"
"""The files of a data set of three cameras and more, and those that were computed from it."""
PARTS, REPLACED = "several", "several_replaced"
"""Files of cameras and a table that are no data set yet, and those that a later one replaced."""
VALIDATION = "calibration_evaluation"
"""The kind of the validation that was made with the last result."""
PAGES = (CHECK, CLICKS)
"""Pages with photographs of their own, which are a project in the same file."""
SCOPE = "pair "
"""How parts and kinds begin that are of a pair of a rig, or of a page with photographs of its own:
this, the name of the pair or of the page, and a slash."""
PAIRED = {"value": "part", "named": "part", "result": "kind", "job": "kind", "found": "kind"}
"""Tables, and their columns with a scope."""
VALUES = tuple(field.name for field in fields(Inputs) if field.name not in ("files", "labels"))
ANY = "*"
Key = tuple[Table, str, str]
"""The table; the part of a value or file, or the kind of a result; and the name of a value."""


@dataclass(frozen=True)
class Held:
    """A kind of what a project holds, and how it travels."""

    words: str
    """What it is."""
    place: str = ""
    """The folder of a part's files, or the file of a result, in a zip."""
    stays: str = ""
    """Why it stays behind; empty if it travels."""
    since: int = 1
    """The first edition of this list that has it; a new entry takes the next number."""


def _files() -> Iterator[tuple[Key, Held]]:
    """The parts with files, and their folders in a zip."""
    folders = {INPUT: "inputs", CALIBRATED: "calibrated", FURTHER: "datasets", BAR: "photographs"}
    of_boards = tuple(f"boards_{camera}" for camera in CAMERAS)
    of_application = (POINT_FILES, TABLES, ASKING, SETS, APPLIED, WORLD)
    named_alike = (*of_boards, *of_application, CHECK, RECORDING, RIG_FILES, PARTS, REPLACED)
    folders |= {part: part for part in named_alike}
    for part, folder in folders.items():
        yield ("named", part, ANY), Held(f"files ({folder})", folder)


def _results() -> Iterator[tuple[Key, Held]]:
    """The kinds of results, and their files in a zip: arrays as `.npz`, records as `.json`."""
    arrays = "evaluation", VALIDATION, *(f"{of}_{c}" for of in ("boards", "lens") for c in CAMERAS)
    texts = "calibration", "frames", "recommended", APPLIED
    for suffix, kinds in ((".npz", arrays), (".json", texts)):
        for kind in kinds:
            yield ("result", kind, ANY), Held(f"results ({kind})", f"{kind}{suffix}")


CONTENTS: dict[Key, Held] = {
    **{("value", INPUT, name): Held("measured lengths and frames") for name in VALUES},
    ("value", SETTING, ANY): Held("settings"),
    ("value", BAR, "pairs"): Held("edited pairs"),
    ("value", BAR, "pairing"): Held("how photographs are paired"),
    **{
        ("value", BAR, name): Held("what was found of boards")
        for name in ("found_by", "boards_found", "boards_doubtful")
    },
    ("value", CLICKS, ANY): Held("points clicked in photographs"),
    **dict(_files()),
    **dict(_results()),
    ("edit", "", ANY): Held("corrections that can be undone"),
    ("file", "", ANY): Held("the days on which files were given", since=2),
    ("job", "", ANY): Held("running jobs", stays="a job is a process of one server"),
    ("found", "", ANY): Held("unfinished searches", stays="it belongs to a job"),
}
"""Contents of files travel with their names; those without one are uploads that nobody took."""


def edition() -> int:
    """The edition of the list, which each zip states."""
    return max(entry.since for entry in CONTENTS.values())


def held(table: Table, part: str = "", name: str = ANY) -> Held | None:
    """The entry of the list; None if a project holds no such thing."""
    return CONTENTS.get((table, part, name)) or CONTENTS.get((table, part, ANY))


def travels(table: Table, part: str = "", name: str = ANY) -> bool:
    """Whether a zip or a copy has this."""
    return (entry := held(table, part, name)) is not None and not entry.stays


def refuse_unlisted(table: Table, part: str, names: Iterable[str] = (ANY,)) -> None:
    """Stop a write of what is not on the list: it would be lost on the way."""
    unlisted = [name for name in names if held(table, part, name) is None]
    assert not unlisted, (table, part, unlisted)
