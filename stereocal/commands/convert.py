"""`stereocal convert`: conversion of parameters to and from the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereocal.commands.options import add_lens_model, add_questions, answers, image_size
from stereocal.formats.exchange.exchange import (
    FORMATS,
    export,
    export_notes,
    export_rig,
    import_parameters,
)
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.exchange.questions import ORIGIN
from stereocal.formats.world_file import read_world
from stereocal.network.rig_file import RigFile, holds_rig
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The options of the command."""
    command = commands.add_parser(
        "convert", help="parameters to and from the formats of other programs"
    )
    command.set_defaults(run=run)
    command.add_argument(
        "parameters",
        type=Path,
        help="a parameter file or rig.json; with --from, the other program's",
    )
    direction = command.add_mutually_exclusive_group(required=True)
    direction.add_argument("--to", choices=tuple(FORMATS), help="write this format")
    direction.add_argument(
        "--from", dest="origin_format", choices=tuple(FORMATS), help="read this format"
    )
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        help="folder to create; or a file name with its suffix, for formats of a single file",
    )
    add_questions(command, "unit")
    add_lens_model(command)
    dlt = command.add_argument_group("DLT coefficients")
    add_questions(dlt, *ORIGIN)
    dlt.add_argument(
        "--world",
        type=Path,
        metavar="FILE",
        help="world.json of the command world, or a 4x4 matrix (JSON or CSV) from the primary "
        "camera's coordinates to yours",
    )
    for which in CAMERAS:
        command.add_argument(
            f"--image-size-{which}",
            metavar="WxH",
            help="with --from, for files that do not state it (DLT, OpenCV)",
        )


def run(parsed: argparse.Namespace) -> None:
    """Convert, and print the files written."""
    options = ExchangeOptions(
        (image_size(parsed.image_size_primary), image_size(parsed.image_size_secondary)),
        world=None if parsed.world is None else read_world(parsed.world),
        **answers(parsed),
    )
    if parsed.to is not None:
        if holds_rig(parsed.parameters):
            own = RigFile.load(parsed.parameters)
            posed = [(name, own.cameras[name], own.poses[name]) for name in own.names]
            for path in export_rig(posed, parsed.to, parsed.out, options):
                print(f"wrote {path}")
            return
        rig = RigParameters.load(parsed.parameters)
        written = export(rig, parsed.to, parsed.out, options)
        for note in export_notes(rig, parsed.to):
            print(f"Note: {note}")
    else:
        import_parameters(parsed.parameters, parsed.origin_format, options).save(parsed.out)
        written = [parsed.out]
    for path in written:
        print(f"wrote {path}")
