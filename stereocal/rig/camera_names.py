"""Names of cameras, which are also names of files and of columns."""

from collections.abc import Iterable
from itertools import combinations
from unicodedata import category

from stereocal.errors import StereocalError

LONGEST_NAME = 64
LETTERS, OTHERS = "LMN", " -_."
"""Categories of characters: letters, marks on letters, numbers; and other characters."""


def check_camera_names(names: Iterable[str]) -> None:
    """Refuse names that cannot be part of the name of a file, and pairs whose files would be one.

    Raises:
        StereocalError: names the camera.
    """
    names = [*names]
    for name in names:
        known = all(sign in OTHERS or category(sign)[0] in LETTERS for sign in name)
        whole = 0 < len(name.strip(" ")) == len(name) <= LONGEST_NAME
        if not (known and whole) or name[0] == ".":
            raise StereocalError(
                f"A camera cannot be called {name[:LONGEST_NAME]!r}, since files are named after "
                f"it: rename it, with 1 to {LONGEST_NAME} letters, digits, spaces, -, _ or . (no "
                "dot at the beginning)."
            )
    pairs: dict[str, tuple[str, str]] = {}
    for pair in combinations(names, 2):
        other = pairs.setdefault("-".join(pair).casefold(), pair)
        if other != pair:
            raise StereocalError(
                f"The files of the cameras {' and '.join(other)} and those of {' and '.join(pair)} "
                "would have one name: rename a camera."
            )
