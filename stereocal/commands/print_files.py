"""`stereocal print`: targets and boards to print at true scale, and the field sheet of a plan."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from stereocal.commands.options import BOARD, LENSES_AND_LENGTHS, contents, pattern_of
from stereocal.commands.parser import ONE_OF, Options, take
from stereocal.detection.target import Tags, parse_target
from stereocal.errors import StereocalError
from stereocal.field.printing.paper import PAPERS, Sheet, paper_named
from stereocal.field.printing.print_target import GOOD_PX, target_size
from stereocal.field.printing.prints import print_board, print_tags, print_targets
from stereocal.field.printing.sheet import field_sheet
from stereocal.formats.camera_file import read_camera
from stereocal.formats.plan_file import read_plan
from stereocal.system.atomic_files import write_atomically

PAPER: Options = {"--paper NAME": f"{', '.join(PAPERS)} (default: A4)"}
DRAWN: Options = {**PAPER, "--out FILE": ".pdf or .svg"}
KINDS: Mapping[str, tuple[str, Options]] = {
    "target": (
        "the two targets of the bar",
        {
            ONE_OF: {
                "--side M": "side of a target, in metres",
                "--camera FILE": "a camera file, with --far",
                "--focal PX": "focal length in px, with --far",
            },
            "--far M": "largest distance of the bar",
            "--near M": "least distance (default: --far)",
            "--px N": {
                "type": float,
                "default": GOOD_PX,
                "help": f"width in the photographs at the largest distance (default: {GOOD_PX:g})",
            },
            **DRAWN,
        },
    ),
    "board": ("the board for the lens calibration", {**BOARD, **DRAWN}),
    "tags": (
        "two tags for the ends of the bar",
        {
            "--target KIND": {"required": True, "help": "as for detect: tags:4X4_50:3,7"},
            "--side M": {"required": True, "help": "side of a black square, in metres"},
            **DRAWN,
        },
    ),
    "sheet": (
        "a plan on one page, to take along",
        {"plan": {"metavar": "PLAN.json"}, **LENSES_AND_LENGTHS, **PAPER, "--out FILE": ".pdf"},
    ),
}
"""What is printed, with its help and options."""


def add(command: argparse.ArgumentParser) -> None:
    """The options of what is printed."""
    kinds = command.add_subparsers(dest="kind", required=True, metavar="|".join(KINDS))
    for name, (about, options) in KINDS.items():
        one = kinds.add_parser(name, help=about)
        take(one, options)
        one.set_defaults(paper="A4")


def run(parsed: argparse.Namespace) -> None:
    """Print, and say what was written."""
    kinds = {"target": _target, "board": _board, "tags": _tags, "sheet": _sheet}
    kinds[parsed.kind](parsed)


def _target(parsed: argparse.Namespace) -> None:
    side = parsed.side
    if side is None:
        if parsed.far is None:
            raise StereocalError("State --far, the largest distance of the bar in metres.")
        near = parsed.far if parsed.near is None else parsed.near
        size = target_size(_focal_px(parsed), near, parsed.far, parsed.px)
        print(size.sentence)
        side = size.side_m
    _write(print_targets(side, paper_named(parsed.paper)), parsed.out)


def _focal_px(parsed: argparse.Namespace) -> float:
    if parsed.camera is None:
        return float(parsed.focal)
    (content,) = contents([parsed.camera]).values()
    camera = read_camera(content, str(parsed.camera))
    return float(min(camera.K[0, 0], camera.K[1, 1]))


def _board(parsed: argparse.Namespace) -> None:
    _write(print_board(pattern_of(parsed), paper_named(parsed.paper)), parsed.out)


def _tags(parsed: argparse.Namespace) -> None:
    target = parse_target(parsed.target)
    if not isinstance(target, Tags):
        raise StereocalError(f'"{parsed.target}" are no tags: write tags:4X4_50:3,7.')
    _write(print_tags(target, parsed.side, paper_named(parsed.paper)), parsed.out)


def _sheet(parsed: argparse.Namespace) -> None:
    paper = paper_named(parsed.paper)
    _check_suffix(parsed.out, ".pdf")
    write_atomically(parsed.out, field_sheet(read_plan(parsed.plan, parsed.lens_model), paper))
    print(f"wrote {parsed.out}")


def _write(sheet: Sheet, out: Path) -> None:
    _check_suffix(out, ".pdf", ".svg")
    content = sheet.pdf() if out.suffix.lower() == ".pdf" else sheet.svg().encode()
    write_atomically(out, content)
    print(f"wrote {out}: print it at 100 % on {sheet.paper.name}")


def _check_suffix(out: Path, *suffixes: str) -> None:
    if out.suffix.lower() not in suffixes:
        raise StereocalError(f'"{out}" must end in {" or ".join(suffixes)}.')
