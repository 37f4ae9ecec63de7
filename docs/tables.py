"""Write the tables of formats into the documentation: `python -m docs.tables`."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from stereocal.formats.described import PROGRAMS

PAGE = Path(__file__).parent / "formats.md"
HEADS = ("`--from`", "files", "pose", "unit", "what to know")


def cameras() -> list[tuple[str, ...]]:
    """A row for each program whose camera files are described."""
    rows: list[tuple[str, ...]] = [HEADS]
    for name, program in PROGRAMS.items():
        pose = (program.pose or "not read").replace("_", " ")
        key = f"`{name}`" if program.pose else ""
        rows.append((key, program.known_as, pose, program.unit or "", program.note))
    return rows


TABLES: Mapping[str, Callable[[], list[tuple[str, ...]]]] = {"cameras": cameras}


def written(text: str) -> str:
    """The page with the tables as the program's rows are now."""
    for name, rows_of in TABLES.items():
        head, *rows = rows_of()
        lines = [head, ("---",) * len(head), *rows]
        table = "".join(f"| {' | '.join(cells)} |\n" for cells in lines).replace("|  |", "| |")
        begin, end = f"<!-- table: {name} -->\n", "<!-- end of the table -->"
        body = begin + re.sub(r" +", " ", table)
        before, _, after = text.partition(begin)
        text = before + body + end + after.partition(end)[2]
    return text


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
