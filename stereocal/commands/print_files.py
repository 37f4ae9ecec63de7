"""`stereocal print`: targets and boards to print at true scale, and the field sheet of a plan."""

import argparse
from collections.abc import Mapping

from stereocal.commands.console import ONE_OF, Number, Options, take
from stereocal.commands.options import BOARD, LENSES_AND_LENGTHS, contents, pattern_of
from stereocal.detection.target import Tags, parse_target
from stereocal.errors import StereocalError
from stereocal.field.printing.paper import PAPERS, Paper, Sheet, paper_named
from stereocal.field.printing.print_target import GOOD_PX, target_size
from stereocal.field.printing.prints import print_board, print_tags, print_targets
from stereocal.field.printing.sheet import field_sheet
from stereocal.formats.camera_file import read_camera
from stereocal.formats.plan_file import read_plan
from stereocal.system.atomic_files import write_atomically
from stereocal.system.numbers import POSSIBLE_PX

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
                "type": Number(float, *POSSIBLE_PX),
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
    kinds = command.add_subparsers(dest="kind", required=True, metavar="|".join(KINDS))
    for name, (help_text, options) in KINDS.items():
        parser = kinds.add_parser(name, help=help_text)
        take(parser, options)
        parser.set_defaults(paper="A4")


def run(parsed: argparse.Namespace) -> None:
    out, paper, suffix = parsed.out, paper_named(parsed.paper), parsed.out.suffix.lower()
    suffixes = (".pdf",) if parsed.kind == "sheet" else (".pdf", ".svg")
    if suffix not in suffixes:
        raise StereocalError(f'"{out}" must end in {" or ".join(suffixes)}.')
    if parsed.kind == "sheet":
        write_atomically(out, field_sheet(read_plan(parsed.plan, parsed.lens_model), paper))
        print(f"wrote {out}")
        return
    if parsed.kind == "board":
        sheet = print_board(pattern_of(parsed), paper)
    else:
        sheet = {"target": _target, "tags": _tags}[parsed.kind](parsed, paper)
    write_atomically(out, sheet.pdf() if suffix == ".pdf" else sheet.svg().encode())
    print(f"wrote {out}: print it at 100 % on {sheet.paper.name}")


def _target(parsed: argparse.Namespace, paper: Paper) -> Sheet:
    side, focal = parsed.side, parsed.focal
    if side is None:
        if parsed.far is None:
            raise StereocalError("State --far, the largest distance of the bar in metres.")
        near = parsed.far if parsed.near is None else parsed.near
        if parsed.camera is not None:
            (content,) = contents([parsed.camera]).values()
            K = read_camera(content, str(parsed.camera)).K
            focal = float(min(K[0, 0], K[1, 1]))
        size = target_size(focal, near, parsed.far, parsed.px)
        print(size.sentence)
        side = size.side_m
    return print_targets(side, paper)


def _tags(parsed: argparse.Namespace, paper: Paper) -> Sheet:
    target = parse_target(parsed.target)
    if not isinstance(target, Tags):
        raise StereocalError(f'"{parsed.target}" are no tags: write tags:4X4_50:3,7.')
    return print_tags(target, parsed.side, paper)
