"""What each column of a table of points holds: proposed from the header, stated by a person.

    roles = propose_roles(rows)                  # "frame,target,x:1,y:1,x:2,y:2" as text
    layout = with_names(layout_of_roles(roles, rows), content, "bars.csv")

Points may stand a frame, a point or an image a row: the camera and the target of a point are named
by a column, or by the header of its x and y.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

from stereocal.errors import StereocalError
from stereocal.formats.point_files import PointColumns, PointLayout, is_number_or_empty, with_words
from stereocal.system.names import word_list
from stereocal.system.numbers import is_number

Kind = Literal["-", "frame", "camera", "target", "x", "y"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LOOKED_FOR: tuple[Kind, ...] = ("frame", "target", "camera")
AXES: tuple[Kind, ...] = ("x", "y")
ONE_CAMERA, ONE_POINT = "cam1", "point"
BY_ROLES = "a table with named columns"
ROLES_HELP = (
    "what each column holds, in order and with commas: frame, camera, target, x, y, x:CAMERA, "
    "x:CAMERA:TARGET, or - if it is not used; such as frame,target,x:1,y:1,x:2,y:2"
)


_WORDS: dict[Kind, tuple[str, ...]] = {
    "frame": word_list(
        "frame frames photo foto image img picture bild shot time t index idx nr no"
    ),
    "camera": word_list("camera cam kamera cameras view"),
    "target": word_list(
        "target targets marker end ende ball point punkt part bodypart bodyparts node keypoint "
        "landmark label name"
    ),
    "x": word_list("x u col column spalte cx"),
    "y": word_list("y v row zeile cy"),
}
"""Words of headers, the likeliest first."""
_STAMPS = word_list("timestamp stamp ts zeitstempel")
"""Words of headers that are the frame in tables with a row for each point, which need one."""
_FILL = word_list("px pixel pixels pix coord coordinate pos position centroid of the in bar raw")
_SIDES = word_list(
    "left right primary secondary top bottom front side upper lower links rechts gauche droite "
    "oben unten l r"
)
_CAMERA = re.compile(r"\b(?:camera|kamera|cam|view|c) ?(\d+|[a-h])\b", re.IGNORECASE)


@dataclass(frozen=True)
class Role:
    """What a column holds; camera and target of an x or y, where its header names them."""

    kind: Kind = "-"
    camera: str = ""
    target: str = ""

    def __str__(self) -> str:
        return ":".join((self.kind, self.camera, self.target)).rstrip(":")


@dataclass(frozen=True)
class ProgramColumns:
    """The columns of a program's table, which has a row for each point of each camera. A table
    with all of them is the program's."""

    program: str
    names: Mapping[Kind, tuple[str, ...]]
    """In lower case; several are of different versions, the first that is there counts."""
    only: tuple[str, str] | None = None
    """A column, and how its cells begin in the rows that count, if there are such. It names the
    targets if their column has one name."""


CALISCOPE = ProgramColumns(
    "Caliscope",
    {
        "frame": ("sync_index",),
        "camera": ("cam_id", "port"),
        "target": ("keypoint_id", "point_id"),
        "x": ("img_loc_x",),
        "y": ("img_loc_y",),
    },
)
"""`xy_*.csv`: `sync_index` counts the instants of all cameras, `frame_index` each camera's own
images, and `obj_loc_x` is on the board. mprib/caliscope, `ImagePoints` (`port` in older ones)."""
OPENLPT = ProgramColumns(
    "OpenLPT",
    {"frame": ("frame",), "camera": ("camera",), "target": ("pointidx",), "x": ("x",), "y": ("y",)},
    ("status", "filtered"),
)
"""`Frame,Camera,Status,PointIdx,X,Y,Radius,Metric`: raw detections too, which do not count;
`Filtered_Small` and `Filtered_Large` are the wand's ends. OpenLPT_GUI, `load_observations_csv`."""


Roles = tuple[Role, ...]
UNUSED = Role()
OWN_COUNT = "camera frame"
"""A header that names the frame by the camera's own count, no camera."""
MOST_TITLES = 4
"""Rows above the header that are looked past."""
TAKEN = ("frame", "u", "v", "point")
"""Names of the columns that points are read into."""


def roles_text(roles: Sequence[Role]) -> str:
    """The roles as one text, which `parse_roles` reads."""
    return ",".join(map(str, roles))


def own_count_of(layout: PointLayout) -> int | None:
    """The column of a table that is called `camera_frame`, each camera's own count of frames."""
    names = [_plain(title)[1].lower() for title in layout.titles]
    return names.index(OWN_COUNT) if OWN_COUNT in names else None


def counts_own(layout: PointLayout) -> bool:
    """Whether the frames of a table are each camera's own count, by the name of their column."""
    return layout.frame is not None and layout.frame == own_count_of(layout)


def parse_roles(text: str, source: str) -> Roles:
    """The roles of a text such as `frame,target,x:left,y:left,x:right,y:right`."""
    roles = []
    for number, part in enumerate(text.split(","), 1):
        kind, camera, target = (*(word.strip() for word in part.split(":", 2)), "", "")[:3]
        named = kind in ("x", "y")
        if kind.lower() not in KINDS or (camera and not named):
            raise StereocalError(
                f"{source}: column {number} cannot be {part.strip()[:40]!r}: it must be frame, "
                "camera, target, x, y, x:CAMERA, x:CAMERA:TARGET (y likewise), or -."
            )
        roles.append(Role(cast(Kind, kind.lower()), camera, target))
    return tuple(roles)


def propose_roles(rows: Sequence[Sequence[str]]) -> Roles:
    """The roles that the header names; columns that it does not explain are unused.

    Args:
        rows: the first rows of the table, the header first.
    """
    names = [_plain(name) for name in rows[0]]
    roles = [UNUSED] * len(names)
    pairs = _coordinates(names)
    free = [k for k in range(len(names)) if not any(k in pair for pair in pairs)]
    for kind in LOOKED_FOR:
        if (column := _likeliest(names, free, kind)) is not None:
            roles[column] = Role(kind)
            free.remove(column)
    named = {role.kind for role in roles}
    stamps = [k for k in free if {*names[k][1].lower().split()} & {*_STAMPS} and not names[k][0]]
    if "camera" in named and "frame" not in named and len(stamps) == 1:
        roles[stamps[0]] = Role("frame")
    stems = [names[x][1] for x, _ in pairs]
    for (x, y), (camera, target) in zip(pairs, _named(stems, named), strict=True):
        roles[x], roles[y] = Role("x", camera, target), Role("y", camera, target)
    return tuple(roles)


def problem_of(roles: Sequence[Role], for_bars: bool) -> str:
    """Why points cannot be read by these roles, in words for a person; empty if they can.

    Args:
        for_bars: two targets, each in two cameras, are wanted.
    """
    for kind in ("frame", "camera", "target"):
        if sum(role.kind == kind for role in roles) > 1:
            return f"Two columns are the {kind}: choose one."
    xs, ys = ([role for role in roles if role.kind == kind] for kind in ("x", "y"))
    if not xs or not ys:
        return "Choose the columns with x and y, the position in the image in pixels."
    places = [sorted((role.camera, role.target) for role in axis) for axis in (xs, ys)]
    if places[0] != places[1] or len(set(places[0])) < len(places[0]):
        return "Each point needs one column with its x and one with its y in a camera."
    if not for_bars:
        return ""
    kinds = {role.kind for role in roles}
    if "camera" in kinds and "frame" not in kinds:
        return "Which column has the frame?"
    if "camera" not in kinds and len({role.camera for role in xs}) < 2:
        return "Which columns are of the other camera, or which column names the camera?"
    if "target" not in kinds and len({role.target for role in xs}) < 2:
        return "Which column says which end of the bar it is?"
    return ""


def header_row(rows: Sequence[Sequence[str]]) -> int:
    """The row without numbers whose names explain most columns, from 0; 0 if none explains any."""
    tried = [k for k, row in enumerate(rows[:MOST_TITLES]) if not any(map(is_number, row))] or [0]
    return max(tried, key=lambda k: sum(role != UNUSED for role in propose_roles(rows[k:])))


def guess_by_roles(rows: list[list[str]]) -> PointLayout | None:
    """The layout of a table whose header names the frame and all that is needed."""
    roles = propose_roles(rows[header_row(rows) :])
    named = any(role.kind == "frame" or role.camera or role.target for role in roles)
    return layout_of_roles(roles, rows) if named and not problem_of(roles, False) else None


def guess_by_program(columns: ProgramColumns, rows: list[list[str]]) -> PointLayout | None:
    """The layout of a program's table; None if it is none."""
    titles = [cell.strip().lower() for cell in rows[0]]
    by_name = {
        kind: next((n for n in names if n in titles), "") for kind, names in columns.names.items()
    }
    if not all(by_name.values()):
        return None
    only = None
    if columns.only is not None and columns.only[0] in titles:
        only = (titles.index(columns.only[0]), columns.only[1])
    roles = [UNUSED] * len(titles)
    for kind, name in by_name.items():
        roles[titles.index(name)] = Role(kind)
    return replace(layout_of_roles(roles, rows), program=columns.program, only=only)


def layout_of_roles(roles: Sequence[Role], rows: Sequence[Sequence[str]]) -> PointLayout:
    """The layout of these roles; the names in its columns are those of `with_names`.

    Args:
        rows: the first rows, perhaps with a header and titles above it.
    """
    above = header_row(rows)
    column_by_kind = {role.kind: k for k, role in enumerate(roles)}
    ys = {(role.camera, role.target): k for k, role in enumerate(roles) if role.kind == "y"}
    columns = tuple(
        PointColumns(
            role.camera or ONE_CAMERA, role.target or ONE_POINT, k, ys[role.camera, role.target]
        )
        for k, role in enumerate(roles)
        if role.kind == "x"
    )
    pixels = [k for point in columns for k in (point.u, point.v)]
    header = above
    while header < len(rows) - 1 and not any(
        is_number(rows[header][k]) for k in pixels if k < len(rows[header])
    ):
        header += 1
    titles = [name.strip() for name in rows[above]] if header > above else []
    unused = [k for k in range(len(titles)) if k >= len(roles) or roles[k] == UNUSED]
    further = tuple(
        (titles[k], k)
        for k in unused
        if titles[k] and titles.count(titles[k]) == 1 and titles[k].lower() not in TAKEN
    )
    return PointLayout(
        BY_ROLES,
        columns,
        header,
        frame=column_by_kind.get("frame"),
        further=further,
        camera_column=column_by_kind.get("camera"),
        point_column=column_by_kind.get("target"),
        zero_is_missing=len(columns) > 1,
        roles=roles_text(roles),
        titles=tuple(titles),
    )


def column_titles(rows: Sequence[Sequence[str]]) -> list[str]:
    """The names of the columns, or their numbers."""
    above = header_row(rows)
    width = max(len(row) for row in rows[above : above + 2])
    head = [*rows[above], *(width - len(rows[above])) * [""]]
    named = not all(is_number_or_empty(name) for name in head)
    return [name.strip()[:40] * named or f"column {k}" for k, name in enumerate(head, 1)]


def with_names(layout: PointLayout, content: bytes, source: str) -> PointLayout:
    """The layout with the names in its columns of the camera and the target."""
    if layout.camera_column is None and layout.point_column is None:
        return layout
    layout = with_words(content, layout, source)
    if layout.only is None or len(layout.points) > 1:
        return layout
    by_only = replace(layout, point_column=layout.only[0], only=layout.only)
    return with_words(content, by_only, source)


def ends_and_cameras(stems: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """The camera and the end of a bar of each file, by words in its name: `A_left`, `cam2-B`.

    Args:
        stems: names of files without folders and endings, by any key.

    Returns:
        Cameras in their usual order, then ends; empty if the names do not tell both.
    """
    for split in (_by_number, _by_side):
        read = {key: split(" ".join(_words(stem)).lower()) for key, stem in stems.items()}
        cameras, ends = ({pair[k] for pair in read.values()} for k in (0, 1))
        is_whole = len({*read.values()}) == len(read) == len(cameras) * len(ends)
        if is_whole and min(len(cameras), len(ends)) > 1 and "" not in cameras | ends:
            return dict(sorted(read.items(), key=lambda item: (*_ranked(item[1][0]), item[1][1])))
    return {}


def _ranked(camera: str) -> tuple[int, int, str]:
    side = _SIDES.index(camera) if camera in _SIDES else 0
    return side, int(camera) if camera.isdecimal() else 0, camera


def titles_name_cameras(titles: Iterable[str]) -> bool:
    """Whether headers of x and y name cameras by a word that says so."""
    return any(_split(stem)[0] for axis, stem in map(_plain, titles) if axis)


def _words(name: str) -> list[str]:
    """The words of a header or of the name of a file, numbers apart."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name.strip())
    text = re.sub(r"[^\w]|_", " ", text)
    return re.sub(r"(?<=[^\W\d_])(?=\d)|(?<=\d)(?=[^\W\d_])", " ", text).split()


def _plain(name: str) -> tuple[str, str]:
    """The axis that a header names, or empty, and its other words."""
    words = [word for word in _words(name) if word.lower() not in _FILL]
    lower = [word.lower() for word in words]
    for axis in AXES:
        for place in reversed(range(len(words))):
            if lower[place] in _WORDS[axis]:
                return axis, " ".join(words[:place] + words[place + 1 :])
    if words and len(words[-1]) > 1 and lower[-1][-1] in "xyuv":  # leftx, ay
        return ("x" if lower[-1][-1] in "xu" else "y"), " ".join([*words[:-1], words[-1][:-1]])
    return "", " ".join(words)


def _coordinates(names: list[tuple[str, str]]) -> list[tuple[int, int]]:
    """The columns of x and y of each point, in the order of the file."""
    columns_by_stem: dict[str, list[list[int]]] = {}
    for k, (axis, stem) in enumerate(names):
        if axis:
            columns_by_stem.setdefault(stem, [[], []])["xy".index(axis)].append(k)
    return sorted((xs[0], ys[0]) for xs, ys in columns_by_stem.values() if len(xs) == len(ys) == 1)


def _likeliest(names: list[tuple[str, str]], free: Iterable[int], kind: Kind) -> int | None:
    """The free column whose header has the likeliest word of a role."""
    ranked = [
        (rank, k)
        for k in free
        for rank, word in enumerate(_WORDS[kind])
        if not names[k][0]
        and word in names[k][1].lower().split()
        and (kind == "frame" or names[k][1].lower() != OWN_COUNT)
    ]
    return min(ranked)[1] if ranked else None


def _named(stems: list[str], named: set[Kind]) -> list[tuple[str, str]]:
    """Camera and target of each point's x and y, by the words of their headers."""
    points = [_split(stem) for stem in stems]
    if "camera" in named:
        return [("", stem) for stem in stems]
    if "target" in named:  # what else differs is the camera
        return [(camera or target, "") for camera, target in points]
    if all(camera for camera, _ in points):
        return points
    if len(stems) > 1 and not any(camera for camera, _ in points):  # the word that repeats
        words = [stem.split() for stem in stems]
        if {len(pair) for pair in words} == {2} and len({pair[0] for pair in words}) < len(stems):
            digits = all(pair[1].isdigit() for pair in words)
            first, second = (1, 0) if digits and not words[0][0].isdigit() else (0, 1)
            return [(pair[first], pair[second]) for pair in words]
    return [("", stem) for stem in stems]


def _split(stem: str) -> tuple[str, str]:
    """The camera that words name, or empty, and the other words."""
    camera, rest = _by_number(stem)
    return (camera, rest) if camera else _by_side(stem)


def _by_number(stem: str) -> tuple[str, str]:
    if (numbered := _CAMERA.search(stem)) is None:
        return "", stem
    rest = stem[: numbered.start()] + stem[numbered.end() :]
    return numbered[1], " ".join(rest.split())


def _by_side(stem: str) -> tuple[str, str]:
    words = stem.split()
    side = next((word for word in words if word.lower() in _SIDES), "")
    return side, " ".join(word for word in words if word != side)
