"""The pages of the documentation, and the code in them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.terminal import ROOT

PAGES = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "benchmarks/README.md")),
    *sorted((ROOT / "sample_data").glob("**/README.md")),
    *sorted(path for path in (ROOT / "docs").glob("**/*.md") if "_build" not in path.parts),
)
CANNOT_TELL = (
    "Cannot tell with 407 matched points whether one camera turned by less than 0.14°: a larger "
    "movement would be found (with a probability of 80 %), and none is seen."
)
"""What a check answers of the tutorial's points: page, command and tutorial."""
_CODE = re.compile(r"^```(\w*)\n(.*?)^```$|((?:^(?: {4}[^\n]*)?\n)*^ {4}[^\n]*\n)", re.M | re.S)
"""A fenced block, or one that is indented."""
_FILE = re.compile(r"`([\w.]+\.json)`")


@dataclass(frozen=True)
class Code:
    """A block of code on a page."""

    language: str
    """Empty for one that is indented, or that does not say."""
    text: str
    file: str | None
    """The JSON file that the text before it names last."""


def name_of(page: Path) -> str:
    """The page's path in the repository."""
    return page.relative_to(ROOT).as_posix()


def code_of(page: Path) -> Iterator[Code]:
    """All blocks of code of a page, in order."""
    text = page.read_text(encoding="utf-8")
    for found in _CODE.finditer(text):
        files = _FILE.findall(text[: found.start()])
        yield Code(found[1] or "", found[2] or found[3] or "", files[-1] if files else None)
