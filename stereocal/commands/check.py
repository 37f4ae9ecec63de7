"""`stereocal check`: has a camera moved since the parameters were found?"""

import argparse
import hashlib
import json
import zipfile
from pathlib import Path

import numpy as np

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
from stereocal.field.checking.check_words import notes, sentence, to_json
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import images_of_bars
from stereocal.field.checking.prior import Prior, prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import REPAIRED, repaired_parameters
from stereocal.field.checking.rig_check import check_rig
from stereocal.fit.rig_file import RigFile, holds_rig
from stereocal.formats.inputs import STORED_PROJECT
from stereocal.rig.parameters import RigParameters
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
SMALLEST = Smallest()
DEFAULTS = {"turn": float(np.degrees(SMALLEST.turn_rad)), "baseline_change": SMALLEST.baseline}


def run(parsed: argparse.Namespace) -> None:
    """Check, write `check.json` and any repaired parameters, print the answer."""
    smallest = Smallest(float(np.radians(parsed.turn)), parsed.baseline_change)
    files: dict[str, bytes] = {}
    path, data = parsed.parameters, parsed.dataset
    if holds_rig(path):
        names = ("sigma_px", "pair", "baseline_sigma", "distance_sigma")
        refuse_given(parsed, WITH_RIG, *names)
        rig = RigFile.load(path)
        if data.is_file() and not zipfile.is_zipfile(data):
            recording = recording_in(read_whole(data), str(data), rig)
        else:
            recording = recording_from(parsed, data)
        whole = check_rig(rig, recording, smallest)
        answer, told, remarks = whole.to_json(), whole.sentence, whole.notes
    else:
        path, prior = _prior(path)
        is_file = data.is_file() and data.suffix != STORED_PROJECT
        if is_file and not zipfile.is_zipfile(data):
            why = "is for a data set: leave it out with a table"
            refuse_given(parsed, why, "pair", "baseline_sigma", "distance_sigma")
            images = images_in_table(data, str(data), prior.rig).stating(parsed.sigma_px)
        else:
            refuse_given(parsed, "is for a table of matched points", "sigma_px")
            images = images_of_bars(dataset_from(parsed, data), prior.rig)
        found = recheck(prior, images, smallest)
        if found.offers_repair:
            sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
            files[REPAIRED] = repaired_parameters(found, sha256).dumps().encode()
        answer, told = to_json(found, REPAIRED if found.offers_repair else None), sentence(found)
        instead = f"{path} was checked instead: of this calibration, it fits the images best."
        remarks = [instead * (path != parsed.parameters), *notes(found)]
    answer = {**answer, "parameters": str(path), "dataset": str(data)}
    text = json.dumps(answer, indent=2, allow_nan=False) + "\n"
    finish(parsed.out, {"check.json": text.encode(), **files}, told, notes=remarks)


def _prior(path: Path) -> tuple[Path, Prior]:
    """The prior of the file, or of the refined file of the same calibration beside it.

    That one is taken where the file states no covariance, and for a 3D set, whose images fit its
    lengths rather than each other.
    """
    rig = RigParameters.load(path)
    beside = path.with_name("parameters_refined.json")
    fits_images = "covariance" in (rig.uncertainties or {}) and rig.method != "3d"
    if not fits_images and beside != path and beside.is_file():
        refined = RigParameters.load(beside)
        if refined.inputs.get("sha256") == rig.inputs.get("sha256"):
            return beside, prior_of(refined, str(beside))
    return path, prior_of(rig, str(path))
