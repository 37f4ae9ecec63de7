"""`stereocal rig`: one rig of three cameras and more."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from stereocal.commands.options import questions
from stereocal.commands.parser import Options
from stereocal.commands.progress import ProgressBar, report
from stereocal.errors import StereocalError
from stereocal.figures.rig_report import rig_report
from stereocal.formats.dataset_files import read_recording
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.fuse_files import fuse_files
from stereocal.network.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.network.rig_file import RIG, RigFile, rig_file
from stereocal.network.unknowns import RigSettings
from stereocal.pairs_of_rig import files_of_pairs
from stereocal.system.atomic_files import write_all

OPTIONS: Options = {
    "inputs DATASET...": "a data set with dataset.json of format 2; or refined parameter files of "
    "its pairs",
    "--out OUT": "folder for the files",
    "--time-offset": "bring the cameras into step; each its offset",
    "--pairs": "of every pair also the two sets of the paper, with forecast and threshold",
    "--baseline-sigma S": "of baselines, m",
    **questions("lens_model"),
}


def run(parsed: argparse.Namespace) -> None:
    """Calibrate or fuse, write rig.json, report.html and the pairs' files, print the answer."""
    if all(path.suffix == ".json" and path.is_file() for path in parsed.inputs):
        _fuse(parsed.inputs, parsed.out)
        return
    if len(parsed.inputs) > 1:
        raise StereocalError("Give one data set, or the parameter files (.json) of pairs.")
    recording = read_recording(parsed.inputs[0], parsed.lens_model)
    settings = RigSettings(baseline_sigma_m=parsed.baseline_sigma, time_offsets=parsed.time_offset)
    with ProgressBar("steps") as bar:
        rig = calibrate_rig(recording, settings, bar.show)
    with ProgressBar("pairs") as bar:
        found = rig_file(rig)
        pairs, figures, notes = files_of_pairs(recording, found, parsed.pairs, bar.show)
    for name, own in figures.items():
        found.about["pairs"][name].update(own)
    _write(found, recording.name, parsed.out, pairs, notes)


def _fuse(files: Sequence[Path], out: Path) -> None:
    found = fuse_files(files)
    _write(found, ", ".join(file.stem for file in files), out, {}, [])


def _write(
    rig: RigFile, name: str, out: Path, pairs: dict[str, bytes], notes: Sequence[str]
) -> None:
    files = {
        out / RIG: rig.dumps().encode(),
        out / "report.html": rig_report(rig, name).encode(),
        **{out / own: content for own, content in pairs.items()},
    }
    write_all(files)
    sentences = filter(None, (rig_sentence(rig), loops_sentence(rig)))
    report(*sentences, notes=(*rig_notes(rig), *notes), written=files)
