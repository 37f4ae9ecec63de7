"""The archive of a result: a data set, its parameter files, and what computes them again."""

import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from llvmlite import binding

from stereocal.calibration.methods import ALL_METHODS, CalibrationSettings, Method
from stereocal.errors import StereocalError, damaged, disk_errors
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.formats.dataset_files import pack_dataset, parse_dataset
from stereocal.paper_kit.digests import ADJUSTED, SEARCHED, Tolerance, differences, digest_of
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters
from stereocal.rig.result_file import software_versions
from stereocal.system.json_text import read_json
from stereocal.system.zip_files import unzip
from stereocal.workflow import Run

ARCHIVE = "archive.zip"
"""Name of the archive in a paper kit."""
STATEMENT, FORMAT = "reproduce.json", "stereocal-reproduce/1"
NAMES: Mapping[Method, str] = {
    method: f"parameters_{method}.json" for method in ALL_METHODS if method != "essential"
}
ABOUT = (
    "`python -m stereocal reproduce ARCHIVE.zip --out DIR` computes the parameter files again, "
    "from dataset.json and the settings below, and compares them with those of the archive. The "
    "points are those of the table, with all corrections: photographs are not searched again."
)
DIGESTS = (
    "SHA-256 of the JSON without created and software: keys sorted, no spaces, UTF-8. The same for "
    "the same software and processor."
)
TOLERANCES = (
    "Elsewhere results may differ by the tolerance of the file: the largest difference, relative "
    "to the largest number of the list or to the number itself; parameters: of pose and lenses "
    "(an element of R: in radians), figures: of all other numbers."
)


@dataclass(frozen=True, eq=False)
class ReproducibleResult:
    """What an archive holds."""

    dataset: Dataset
    calibration: CalibrationSettings
    refined: RefineSettings | None
    """None: without a refined set."""
    validation: EvaluationSettings | None
    """None: without a validation."""
    files: Mapping[str, Mapping[str, Any]]
    """Parameter files by name; `parameters_2d.json` may hold the refined set."""
    software: Mapping[str, str]
    processor: Mapping[str, str]


@dataclass(frozen=True)
class FileComparison:
    """How a parameter file that was computed again compares with that of an archive."""

    name: str
    digest: str
    """Of the new file."""
    identical: bool
    tolerance: Tolerance
    differences: tuple[str, ...]
    """Those beyond the tolerance."""

    @property
    def agrees(self) -> bool:
        """Whether it is identical or within the tolerance."""
        return not self.differences


def processor_kind() -> dict[str, str]:
    """System, machine and the processor's family, on which the rounding of results depends."""
    family: str = binding.get_host_cpu_name()
    return {"system": platform.system(), "machine": platform.machine(), "family": family}


def archive_files(run: Run) -> dict[str, bytes]:
    """The files of an archive by name: data set, parameter files, and `reproduce.json`."""
    texts = {NAMES[name]: rig.dumps() for name, rig in run.sets.items()}
    contents = {name: json.loads(text) for name, text in texts.items()}
    refined, evaluation = run.calibration.refined, run.evaluation
    statement = {
        "format": FORMAT,
        "about": ABOUT,
        "calibration": run.calibration.settings.to_json(),
        "refined": None if refined is None else refined.settings.to_json(),
        "validation": None if evaluation is None else evaluation.settings.to_json(),
        "digests": DIGESTS,
        "files": {
            name: {
                "method": content["method"],
                "sha256": digest_of(content),
                "tolerance": asdict(tolerance_of(content)),
            }
            for name, content in contents.items()
        },
        "tolerances": TOLERANCES,
        "software": software_versions(),
        "processor": processor_kind(),
    }
    return {
        **pack_dataset(run.calibration.dataset),
        **{name: text.encode() for name, text in texts.items()},
        STATEMENT: (json.dumps(statement, indent=2, allow_nan=False) + "\n").encode(),
    }


def read_archive(path: Path) -> ReproducibleResult:
    """The result in an archive, in the paper kit that holds it, or in a project's zip."""
    with disk_errors(f"{path} cannot be read"):
        files = unzip(path, path.name, lambda member: "/" not in member)
        if ARCHIVE in files:
            files = unzip(files[ARCHIVE], f"{path.name}, {ARCHIVE}", lambda name: "/" not in name)
    if STATEMENT not in files:
        raise StereocalError(
            f"{path}: there is no {STATEMENT} in it. Take a paper kit or its archive.zip, or a "
            "project's zip with an up-to-date result."
        )
    stated = read_json(files[STATEMENT], f"{path}: {STATEMENT}")
    if not isinstance(stated, dict) or stated.get("format") != FORMAT:
        raise StereocalError(f'{path}: {STATEMENT} must be an object with "format": "{FORMAT}".')
    dataset = parse_dataset(files, str(path), lens_model="brown")
    with damaged(f"{STATEMENT} is damaged.", source=str(path), keep=True):
        if not stated["files"] or not {*stated["files"]} <= {*NAMES.values()}:
            raise ValueError(stated["files"])
        refined, validation = stated["refined"], stated["validation"]
        return ReproducibleResult(
            dataset,
            CalibrationSettings.from_json(stated["calibration"]),
            None if refined is None else RefineSettings.from_json(refined),
            None if validation is None else EvaluationSettings.from_json(validation),
            {name: _archived(files, name, own, path) for name, own in stated["files"].items()},
            dict(stated["software"]),
            dict(stated["processor"]),
        )


def _archived(
    files: Mapping[str, bytes], name: str, entry: Mapping[str, Any], path: Path
) -> Mapping[str, Any]:
    if name not in files:
        raise StereocalError(f"{path}: {name} is missing.")
    content = read_json(files[name], f"{path}: {name}")
    if not isinstance(content, dict) or digest_of(content) != entry["sha256"]:
        raise StereocalError(
            f"{path}: {name} is not the file that {STATEMENT} describes; it was changed since."
        )
    if content["method"] not in NAMES:
        raise ValueError(content["method"])
    return content


def tolerance_of(content: Mapping[str, Any]) -> Tolerance:
    """The tolerance of a set's file. What an archive states is not used: it may be forged."""
    return ADJUSTED if content["method"] == "refined" else SEARCHED


def _naming_all_frames(
    content: Mapping[str, Any], now: Mapping[str, Any], dataset: Dataset
) -> Mapping[str, Any]:
    """A file with the digest of its whole data set: where frames were left out, the refined files
    of version 1.0 have the digest of the others."""
    inputs = content.get("inputs")
    if not (now and isinstance(inputs, dict)):
        return content
    if inputs.get("sha256") != dataset.of_frames(now["inputs"]["frames"]).sha256:
        return content
    return {**content, "inputs": {**inputs, "sha256": dataset.sha256}}


def compare(
    archived: ReproducibleResult, sets: Mapping[str, RigParameters]
) -> list[FileComparison]:
    """Each parameter file of an archive beside the one that was computed again.

    Args:
        sets: by name of the file; one that is missing could not be computed.
    """
    found = []
    for name, content in archived.files.items():
        now = json.loads(sets[name].dumps()) if name in sets else {}
        digest, tolerance = digest_of(now), tolerance_of(content)
        content = _naming_all_frames(content, now, archived.dataset)
        identical = digest == digest_of(content)
        unequal = () if identical else tuple(differences(content, now, tolerance))
        found.append(FileComparison(name, digest, identical, tolerance, unequal))
    return found
