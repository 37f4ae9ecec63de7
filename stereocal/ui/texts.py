"""Longer texts of the pages."""

import re
from collections.abc import Iterable

import pandas as pd

PURPOSE = (
    "Film a bar with two cameras; get the files that turn image points into 3D: one to match "
    "points and one to measure, or one for both."
)

NEEDED = """
1. **A bar with two targets** in 20 to 30 frames, near and far, all over both views: a table of
   points (CSV), or the photographs.
2. **A lens file for each camera**, as OpenCV or stereocal saved it, or about 50 photographs of a
   chessboard by each camera, for the Lenses page.
3. **The baseline**: the distance between the two cameras, measured with a laser range finder.
4. **The distance between the two targets** on the bar, centre to centre.

No more: everything is computed here, and nothing is sent elsewhere.
"""

VALIDATE = """
Many times over, some frames are drawn to calibrate with, and the others test the result.
**Matching**: do correct pairs of points have smaller errors than wrong ones? The overlap of the two
curves (FCP) is the share of wrong pairs accepted and that of correct ones lost, together, at the
threshold where the curves cross. **Best** is what differs from the others beyond the intervals.
**Measuring**: how far off are the lengths of bars that took no part?
Each run finds sets of its own, and 3D sets differ much in matching: what your own files will do is
on the Calibrate page.
"""


BOARDS = """
- Print a chessboard (below), glue it to something flat and stiff, and count its **inner
  corners**: where four squares meet. Leave a white border.
- Take **about 50 photographs**, at the distance and focus of your recordings. The whole board must
  be in view.
- Cover the **whole image**, edges and corners too, and tilt the board by 20 to 50 degrees in
  different directions.
- Zoom and focus must not change between these photographs and your recordings.
- A **video** serves as well: hold the board still for a second in each of these positions. The
  sharpest still frame of each second is taken; a video shorter than 30 s gives 30 frames.
"""

REFINED_SET = """
The paper's two sets keep the lenses and the baseline as they were given. The **refined set** is
fitted to the images and the lengths at once, and lets lenses and baseline move within their
uncertainty. Where these were a little wrong, one refined set can do both jobs better than both.
"""

PAIR = (
    "This is the pair {} of a rig: the points that both cameras saw and the rig was fitted to, "
    "with the lenses and the baseline of the rig. The refined set is the rig's; a frame that you "
    "leave out here is left out of this pair."
)

_WORD = re.compile(r"\S+")
_LINK = re.compile(r"://|www\.|@", re.IGNORECASE)
"""What Streamlit's Markdown makes a link or a mail address of, even if escaped, unless it is code.
Searched for in each word: one pattern for both takes quadratic time in a word without it."""


def escape_markdown(text: str) -> str:
    """Escape untrusted text, such as a file's name, so that it is neither markup nor a link."""
    parts, end = [], 0
    for word in _WORD.finditer(text):
        if _LINK.search(word[0]):
            parts += [_escaped(text[end : word.start()]), _code(word[0])]
            end = word.end()
    return "".join([*parts, _escaped(text[end:])])


def markdown_list(lines: Iterable[str]) -> str:
    """A list of untrusted lines."""
    return "\n".join(f"- {escape_markdown(line)}" for line in lines)


def escaped_table(table: pd.DataFrame) -> pd.DataFrame:
    """Escape cells and headings of untrusted text: `st.table` renders them as Markdown."""
    safe = table.map(lambda cell: escape_markdown(cell) if isinstance(cell, str) else cell)
    return safe.rename(
        index=lambda name: escape_markdown(str(name)),
        columns=lambda name: escape_markdown(str(name)),
    )


def _escaped(text: str) -> str:
    return "".join(f"\\{sign}" if sign in "\\`*_{}[]<>#$~|:" else sign for sign in text)


def _code(word: str) -> str:
    fence = "`" * (max(map(len, re.findall("`+", word)), default=0) + 1)
    space = " " * (word.startswith("`") or word.endswith("`"))
    return f"{fence}{space}{word}{space}{fence}"
