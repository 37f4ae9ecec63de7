"""`stereocal check`: has a camera moved since the parameters were found?"""

import argparse
import hashlib
import json
import zipfile
from functools import partial
from pathlib import Path

from stereocal.commands.console import Number, Options
from stereocal.commands.options import (
    LENSES_AND_LENGTHS,
    PAIR,
    WITH_RIG,
    dataset_from,
    finish,
    recording_from,
    refuse_given,
)
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import NewImages, images_of_bars
from stereocal.field.checking.repair import REPAIRED
from stereocal.field.checking.to_check import with_new
from stereocal.fit.rig_file import Parameters, RigFile, holds_rig
from stereocal.formats.inputs import STORED_PROJECT
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.system.atomic_files import read_whole
from stereocal.workflow.given import images_in_table, recording_in

OPTIONS: Options = {
    "parameters": "the parameter file to check, or rig.json",
    "dataset": "a few new bars: folder or zip with dataset.json, or a table of bars "
    "(correspondences.csv; with rig.json its points.csv); or matched points alone: pairs.csv",
    "--out OUT": "folder for the files",
    "--turn DEG": {
        "type": Number(float, 1e-9, 179.0),
        "help": 'smallest turn that matters; "same" is reported only if it would be seen '
        "(default: %(default).3g)",
    },
    "--baseline-change FRACTION": "smallest change of the baseline that matters (default: "
    "%(default)g)",
    "--sigma-px PX": "noise of matched points, if they are less exact than the targets (default: "
    "of the columns that match writes)",
    **LENSES_AND_LENGTHS,
    **PAIR,
}
DEFAULTS = {"turn": Smallest().turn_deg, "baseline_change": Smallest.baseline}


def run(parsed: argparse.Namespace) -> None:
    """Check, write `check.json` and any repaired parameters, print the answer."""
    path, parameters = _parameters(parsed)
    asked = with_new(parameters, partial(_images, parsed), partial(_recording, parsed))
    check = asked.stating(parsed.sigma_px).check(
        Smallest.of(parsed.turn, parsed.baseline_change),
        str(path),
        hashlib.sha256(path.read_bytes()).hexdigest(),
    )
    content = {**check.content, "parameters": str(path), "dataset": str(parsed.dataset)}
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    files = {"check.json": text.encode()}
    if check.repaired is not None:
        files[REPAIRED] = check.repaired.dumps().encode()
    instead = f"{path} was checked instead: of this calibration, it fits the images best."
    remarks = [instead * (path != parsed.parameters), *check.notes]
    finish(parsed.out, files, check.sentence, notes=remarks)


def _parameters(parsed: argparse.Namespace) -> tuple[Path, Parameters]:
    """The rig; or the parameters of the file, or of the refined file of the same calibration beside
    it.

    That one is taken where the file states no covariance, and for a 3D set, whose images fit its
    lengths rather than each other.
    """
    path: Path = parsed.parameters
    if holds_rig(path):
        refuse_given(parsed, WITH_RIG, "sigma_px", "pair", "baseline_sigma", "distance_sigma")
        return path, RigFile.load(path)
    rig = RigParameters.load(path)
    beside = path.with_name("parameters_refined.json")
    fits_images = "covariance" in (rig.uncertainties or {}) and rig.method != "3d"
    if not fits_images and beside != path and beside.is_file():
        refined = RigParameters.load(beside)
        if refined.inputs.get("sha256") == rig.inputs.get("sha256"):
            return beside, refined
    return path, rig


def _images(parsed: argparse.Namespace, rig: RigParameters) -> NewImages:
    """The new images of two cameras: a table, or a data set."""
    path: Path = parsed.dataset
    if path.is_file() and path.suffix != STORED_PROJECT and not zipfile.is_zipfile(path):
        why = "is for a data set: leave it out with a table"
        refuse_given(parsed, why, "pair", "baseline_sigma", "distance_sigma")
        return images_in_table(path, str(path), rig)
    refuse_given(parsed, "is for a table of matched points", "sigma_px")
    return images_of_bars(dataset_from(parsed, path), rig)


def _recording(parsed: argparse.Namespace, rig: RigFile) -> Recording:
    """The new images of a rig, likewise."""
    path: Path = parsed.dataset
    if path.is_file() and not zipfile.is_zipfile(path):
        return recording_in(read_whole(path), str(path), rig)
    return recording_from(parsed, path)
