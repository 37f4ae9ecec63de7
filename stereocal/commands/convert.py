"""`stereocal convert`: conversion of parameters to and from the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereocal.commands.options import (
    add_lens_model,
    add_questions,
    add_world,
    answers,
    image_size,
    world_from,
)
from stereocal.commands.progress import report
from stereocal.formats.exchange.exchange import FORMATS, export, export_notes, import_parameters
from stereocal.formats.exchange.options import ORIGIN, ExchangeOptions
from stereocal.network.rig_file import RigFile, holds_rig
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters


def add(command: argparse.ArgumentParser) -> None:
    """The options of the command."""
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
    add_world(dlt)
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
        world=world_from(parsed),
        **answers(parsed),
    )
    if parsed.to is not None:
        if holds_rig(parsed.parameters):
            own = RigFile.load(parsed.parameters)
            posed = [(name, own.cameras[name], own.poses[name]) for name in own.names]
            report(written=export(posed, parsed.to, parsed.out, options))
            return
        rig = RigParameters.load(parsed.parameters)
        written = export(rig, parsed.to, parsed.out, options)
        report(notes=export_notes(rig, parsed.to), written=written)
    else:
        import_parameters(parsed.parameters, parsed.origin_format, options).save(parsed.out)
        report(written=[parsed.out])
