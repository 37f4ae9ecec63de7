"""`stereocal convert`: conversion of parameters to and from the formats of other programs."""

import argparse

from stereocal.commands.console import ONE_OF, Options, report
from stereocal.commands.options import (
    LENSES_AND_LENGTHS,
    WORLD,
    answers,
    image_size,
    questions,
    two_cameras,
    world_from,
)
from stereocal.fit.rig_file import RigFile, holds_rig
from stereocal.formats.exchange.exchange import (
    FORMATS,
    READABLE,
    export,
    export_notes,
    import_parameters,
)
from stereocal.formats.exchange.options import ORIGIN, ExchangeOptions
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters

OPTIONS: Options = {
    "parameters": "a parameter file or rig.json; with --from, the other program's",
    ONE_OF: {
        "--to": {"choices": tuple(FORMATS), "help": "write this format"},
        "--from": {"choices": tuple(READABLE), "dest": "origin_format", "help": "read this format"},
    },
    "--out OUT": "folder to create; or a file name with its suffix, for formats of a single file",
    **questions("unit"),
    **LENSES_AND_LENGTHS,
    "DLT coefficients:": {**questions(*ORIGIN), **WORLD},
    "--cameras P,S": "with --from, primary and secondary camera of a file with more than two, or "
    "of two files: 1,3 or names",
    "--image-size WxH": "with --from, of both cameras, for files without it (DLT, OpenCV)",
    **{f"--image-size-{which} WxH": f"of the {which} camera alone" for which in CAMERAS},
}


def run(parsed: argparse.Namespace) -> None:
    size = image_size(parsed.image_size)
    options = ExchangeOptions(
        (
            image_size(parsed.image_size_primary) or size,
            image_size(parsed.image_size_secondary) or size,
        ),
        cameras=None if parsed.cameras is None else two_cameras(parsed.cameras),
        world=world_from(parsed),
        **answers(parsed),
    )
    if parsed.to is not None:
        if holds_rig(parsed.parameters):
            of_all = RigFile.load(parsed.parameters)
            report(written=export(of_all, parsed.to, parsed.out, options))
            return
        rig = RigParameters.load(parsed.parameters)
        written = export(rig, parsed.to, parsed.out, options)
        report(notes=export_notes(rig, parsed.to), written=written)
    else:
        rig = import_parameters(parsed.parameters, parsed.origin_format, options)
        rig.save(parsed.out)
        report(notes=rig.inputs.get("notes", ()), written=[parsed.out])
