"""Options of a command as a table, and the parser that takes them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Options = Mapping[str, Any]
"""Options as the help spells them, with their help, or with all that argparse is told.

`--frames N` takes a value, `--kit` is a switch, and `plan` a file; `FILE...` stands for one or
more. Under `ONE_OF` are options of which one must be given, under a name with a colon a group.
"""
ONE_OF = "one of"
KINDS: Mapping[str, Callable[[str], Any]] = {
    **dict.fromkeys(("K", "N"), int),
    **dict.fromkeys(("D", "DEG", "FAR", "FPS", "FRACTION", "M", "NEAR", "P", "PX", "S"), float),
    **dict.fromkeys(("ADDRESS", "B", "CAMERA", "DICT", "FRAME", "KIND", "NAME"), str),
    **dict.fromkeys(("LEFT-RIGHT", "P,S", "WxH", "18x12"), str),
}
"""What a value is, by its name in the help; else a file."""


def take(to: argparse._ActionsContainer, options: Options) -> None:
    """Add options to a parser or a group; `--out` is required."""
    for spelled, told in options.items():
        if spelled == ONE_OF:
            take(to.add_mutually_exclusive_group(required=True), told)
            continue
        if spelled.endswith(":"):
            take(to.add_argument_group(spelled[:-1]), told)
            continue
        name, *values = spelled.removesuffix("...").split()
        about: dict[str, Any] = {"help": told} if isinstance(told, str) else dict(told)
        if name == "--out":
            about["required"] = True
        if spelled.endswith("..."):
            about["nargs"] = "+"
        if len(values) > 1:
            about |= {"nargs": len(values), "metavar": tuple(values)}
        elif values:
            about["metavar"] = values[0]
        if values or not name.startswith("-"):
            about.setdefault("type", KINDS.get(values[0] if values else "", Path))
        elif not about.keys() & {"action", "choices", "type"}:
            about["action"] = "store_true"
        to.add_argument(name, **about)


class Parser(argparse.ArgumentParser):
    """A parser that takes no empty path: `Path("")` is the current folder."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.register("type", Path, _path)


def _path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("a path is missing: the text is empty")
    return Path(text)
