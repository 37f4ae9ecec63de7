"""Pairs of a rig as earlier versions kept them: each a project of its own in the rig's file, with
inputs, corrections, settings and files.

A pair has results only. What a person gave or said of it goes to the project, where that has
nothing of the kind; results are made again.
"""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from itertools import permutations
from typing import Any

from stereocal.projects.contents import (
    ASKING,
    BAR,
    CHECK,
    CLICKS,
    INPUT,
    PAGES,
    PAIRED,
    POINT_FILES,
    RECORDING,
    SCOPE,
    SETS,
    SETTING,
    TABLES,
    WORLD,
)
from stereocal.rig.camera import CAMERAS

OBJECT_SIGMA = "object_sigma_m"
"""Setting of a project of three cameras."""
NOT_SAID = ("of_rig", "refined_of_rig", "all_frames")
"""Settings of a pair that no person had made."""


def pairs_of_before(db: sqlite3.Connection) -> None:
    """Bring the pairs of a project to the form of this version, in the caller's transaction."""
    stated = _values(db, SETTING).get(OBJECT_SIGMA)
    if isinstance(stated, int | float):  # how well the object of three cameras is known
        row = [INPUT, "target_distance_sigma_m", json.dumps(stated)]
        db.execute("INSERT OR REPLACE INTO value VALUES (?, ?, ?)", row)
    db.execute("DELETE FROM value WHERE part = ? AND name = ?", [SETTING, OBJECT_SIGMA])
    rows = db.execute(
        "SELECT DISTINCT part FROM value WHERE part GLOB ?", [f"{SCOPE}*/{INPUT}"]
    ).fetchall()
    scopes = [str(part).removesuffix(INPUT) for (part,) in rows]
    pairs, pages = dict(_pairs(db)), [f"{SCOPE}{page}/" for page in PAGES]
    for scope in sorted(set(scopes) - set(pages)):
        if (pair := pairs.get(scope.removeprefix(SCOPE).rstrip("/"))) is not None:
            _move_corrections(db, scope, pair)
            is_first = pair[0] == next(iter(pairs.values()))[0]
            _move(db, scope, dict(zip(CAMERAS, pair, strict=True)), is_first)
        for table, column in PAIRED.items():
            in_scope = f"substr({column}, 1, length(?1)) = ?1"
            db.execute(f"DELETE FROM {table} WHERE {in_scope}", [scope])


def _pairs(db: sqlite3.Connection) -> Iterator[tuple[str, tuple[str, str]]]:
    """The pairs of the recording by their names."""
    rows = db.execute(
        "SELECT bytes FROM named JOIN content USING (sha256) "
        "WHERE part = ? AND name LIKE '%dataset.json'",
        [RECORDING],
    ).fetchall()
    for (content,) in rows:
        with suppress(ValueError, TypeError, KeyError):
            for pair in permutations(json.loads(bytes(content))["cameras"], 2):
                yield "-".join(pair), pair


def _values(db: sqlite3.Connection, part: str) -> dict[str, Any]:
    rows = db.execute("SELECT name, json FROM value WHERE part = ?", [part]).fetchall()
    return {str(name): json.loads(text) for name, text in rows}


def _move_corrections(db: sqlite3.Connection, scope: str, pair: tuple[str, str]) -> None:
    """Frames left out of a pair are left out of all; its second camera had targets exchanged."""
    of_pair, whole = _values(db, f"{scope}{INPUT}"), _values(db, INPUT)
    exchanged = whole.get("exchanged")
    exchanged = dict(exchanged) if isinstance(exchanged, dict) else {}
    if of_second := of_pair.get("exchanged"):
        exchanged[pair[1]] = sorted({*exchanged.get(pair[1], []), *of_second})
    left_out = sorted({*(whole.get("left_out") or []), *(of_pair.get("left_out") or [])})
    for name, value in (("exchanged", exchanged), ("left_out", left_out)):
        row = [INPUT, name, json.dumps(value)]
        db.execute("INSERT OR REPLACE INTO value VALUES (?, ?, ?)", row)


def _move(db: sqlite3.Connection, scope: str, names: dict[str, str], is_first: bool) -> None:
    """Settings, and what was given on the pages Apply and Check, by the cameras' names.

    Files of two cameras that Check was given are not moved: they are not of all.

    Args:
        is_first: whether the frame of the pair, in which its world frame is, is that of the rig.
    """
    for name, value in _values(db, f"{scope}{SETTING}").items():
        if name not in NOT_SAID:
            row = [SETTING, name, json.dumps(value)]
            db.execute("INSERT OR IGNORE INTO value VALUES (?, ?, ?)", row)
    for part in (POINT_FILES, TABLES, ASKING):
        for which, camera in names.items():
            _name(db, part, f"camera {camera}", f"{scope}{part}", which)
    check, clicks = f"{CHECK}/{BAR}", f"{CLICKS}/{BAR}"
    places = {part: part for part in (SETS, *([WORLD] if is_first else []))}
    places |= {check: f"{SCOPE}{check}", clicks: f"{SCOPE}{clicks}"}
    for part, to in places.items():
        rows = db.execute("SELECT name FROM named WHERE part = ?", [f"{scope}{part}"]).fetchall()
        for (name,) in rows:
            folder, slash, file = str(name).partition("/")
            _name(db, to, f"{names.get(folder, folder)}{slash}{file}", f"{scope}{part}", name)
    last = max(map(int, _values(db, CLICKS)), default=0)
    acts = sorted(_values(db, f"{scope}{CLICKS}").items())
    for number, (_, act) in enumerate(acts, start=last + 1):
        row = [CLICKS, f"{number:09d}", json.dumps(_renamed(act, names))]
        db.execute("INSERT INTO value VALUES (?, ?, ?)", row)


def _name(db: sqlite3.Connection, part: str, name: str, part_before: str, name_before: str) -> None:
    """Name a file of a pair as one of the project, unless that has one of the name."""
    db.execute(
        "INSERT OR IGNORE INTO named SELECT ?, ?, sha256, about FROM named "
        "WHERE part = ? AND name = ?",
        [part, name, part_before, name_before],
    )


def _renamed(act: Any, names: dict[str, str]) -> Any:
    """An act of clicks, of the cameras by their names."""
    placed = [
        {**click, "camera": names.get(click["camera"], click["camera"])} for click in act["placed"]
    ]
    removed = [
        (frame, names.get(camera, camera), track) for frame, camera, track in act.get("removed", [])
    ]
    return {**act, "placed": placed, "removed": removed}
