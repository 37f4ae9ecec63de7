"""The kit holds what a paper needs; its archive gives the same parameter files again."""

import io
import json
import subprocess
import sys
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.cli import main
from stereocal.figures import journal
from stereocal.paper_kit.digests import ADJUSTED, SEARCHED, differences, digest_of
from stereocal.paper_kit.kit import paper_kit
from stereocal.paper_kit.methods_text import PAPER, PROGRAM, methods_md, references_bib
from stereocal.paper_kit.reproduction import archive_files, compare, read_archive
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import pack_zip
from stereocal.verdict.in_words import digits, interval, percent
from stereocal.workflow import Run
from tests.paper_kit.answers import of_field, of_recording, run_of
from tests.refined.test_time_offset import moving
from tests.terminal import ROOT


def test_a_kit_holds_all_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the figures hold, the tests of the figures prove."""

    def arranged(draw: journal.Draw, width_mm: float) -> dict[str, bytes]:
        assert draw(width_mm).axes
        return {"svg": b"", "pdf": b""}

    monkeypatch.setattr(journal, "rendered", arranged)
    with zipfile.ZipFile(io.BytesIO(paper_kit(of_field()))) as kit:
        names = set(kit.namelist())
        with zipfile.ZipFile(io.BytesIO(kit.read("archive.zip"))) as archive:
            archived = set(archive.namelist())
    drawn = ("validation", "validation_with_refined", "errors_by_frame", "rig")
    ends = [f"{width}mm.{form}" for width in (88, 180) for form in ("svg", "pdf")]
    figures = {f"figures/{name}_{end}" for name in drawn for end in ends}
    assert names == {"methods.md", "references.bib", "table.csv", "archive.zip", *figures}
    assert {"dataset.json", "correspondences.csv", "reproduce.json"} < archived
    assert {f"parameters_{method}.json" for method in ("2d", "3d", "refined")} < archived


def test_the_methods_say_that_the_secondary_points_were_shifted() -> None:
    text = methods_md(Run(moving(0.3)))
    assert "later than the primary. Its points were interpolated" in text
    assert "interpolated" not in methods_md(of_field())


def test_the_methods_say_the_figures_of_the_result() -> None:
    found = of_field()
    text = methods_md(found)
    assert found.evaluation is not None
    for summary in found.evaluation.summaries.values():
        fcp, median = summary.reprojection.fcp, summary.reconstruction.median
        assert f"{percent(fcp.value)} % ({interval(fcp)})" in text
        assert f"{percent(median.value)} % ({interval(median)})" in text
    use = found.recommendation.match
    assert use.threshold_px is not None and use.method == "refined"
    assert f"the refined set below {digits(use.threshold_px, 2)} px is recommended" in text
    for words in (
        *("25 frames", "50 pairs", "25 bars", "0.9 m apart", "baseline was 4.5 m", "seed 0"),
        "In each of 8 runs, 20 frames drawn at random calibrated the system and the other 5",
        *(f"[@{PAPER}]", f"[@{PROGRAM}]", "2336 × 1728 px", "10⁻⁶ rad", "the refined set"),
    ):
        assert words in text, words
    for words in ("left out", "  ", "..", "points were matched", "were reconstructed"):
        assert words not in text


def test_the_references_are_those_of_the_citation_file() -> None:
    """One word for the program's authors, and the same paper."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    bib = references_bib().decode()
    paper = cited["preferred-citation"]
    assert paper["title"] in bib
    assert all(author["family-names"] in bib for author in paper["authors"])
    assert f"year = {{{paper['year']}}}" in bib
    assert paper["url"] in bib
    assert cited["authors"][0]["name"] in bib
    assert cited["version"] in bib
    assert bib.count("{") == bib.count("}")


IDENTICAL = [f"parameters_{method}.json: identical" for method in ("2d", "3d", "refined")]


def archive(
    tmp_path: Path,
    edit: Callable[[dict[str, bytes]], None] = lambda _: None,
    run: Run | None = None,
) -> str:
    """The archive of a result, or the field sample's, with other files in it."""
    files = archive_files(run or of_field())
    edit(files)
    path = tmp_path / "archive.zip"
    path.write_bytes(pack_zip(files))
    return str(path)


def reproduce(path: str, tmp_path: Path) -> int:
    return main(["reproduce", path, "--out", str(tmp_path / "again")])


@pytest.mark.parametrize("answer", [of_field, pytest.param(of_recording, marks=pytest.mark.soak)])
def test_another_process_gives_the_same_digests(answer: Callable[[], Run], tmp_path: Path) -> None:
    files, again = archive_files(answer()), tmp_path / "again"
    path = archive(tmp_path, run=answer())
    command = [sys.executable, "-m", "stereocal", "reproduce", path, "--out", str(again)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert all(line in run.stdout for line in IDENTICAL)
    for name in ("parameters_2d.json", "parameters_refined.json"):
        archived, now = (json.loads(each) for each in (files[name], (again / name).read_bytes()))
        assert digest_of(archived) == digest_of(now)


def test_settings_and_a_replaced_file_come_along(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = CalibrationSettings(SearchSettings(seed=5), "linear", frames_left_out=(2,))
    dataset = of_field().calibration.dataset
    found = run_of(dataset, settings, runs=2, refined=RefineSettings())
    sets: dict[Method, RigParameters] = {"2d": found.sets["refined"], "3d": found.sets["3d"]}
    vars(found)["sets"] = sets
    assert reproduce(archive(tmp_path, run=found), tmp_path) == 0
    printed = capsys.readouterr().out
    assert all(line in printed for line in IDENTICAL[:2])
    again = json.loads((tmp_path / "again" / "parameters_2d.json").read_text())
    assert again["method"] == "refined"


def test_an_archive_names_one_data_set_and_earlier_ones_still_agree(tmp_path: Path) -> None:
    """Where frames were left out, the refined file of version 1.0 named the others alone."""
    dataset = of_field().calibration.dataset
    settings = CalibrationSettings(frames_left_out=(2, 7))
    found = run_of(dataset, settings, runs=0, refined=RefineSettings())
    named = {rig.inputs["sha256"] for rig in found.sets.values()}
    assert named == {dataset.sha256}

    def edit(files: dict[str, bytes], digest: str) -> None:
        refined, statement = "parameters_refined.json", json.loads(files["reproduce.json"])
        content = json.loads(files[refined])
        content["inputs"]["sha256"] = digest
        statement["files"][refined]["sha256"] = digest_of(content)
        files |= {refined: json.dumps(content).encode()}
        files["reproduce.json"] = json.dumps(statement).encode()

    sets = {f"parameters_{method}.json": rig for method, rig in found.sets.items()}
    fitted = dataset.of_frames(np.setdiff1d(dataset.correspondences.frames, (2, 7)))
    for digest, agrees in ((fitted.sha256, True), ("0" * 64, False)):
        archived = read_archive(Path(archive(tmp_path, partial(edit, digest=digest), found)))
        assert archived.dataset.sha256 == dataset.sha256
        assert all(each.agrees for each in compare(archived, sets)) == agrees


def test_a_changed_point_is_different(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def edit(files: dict[str, bytes]) -> None:
        head, first, *rows = files["correspondences.csv"].decode().splitlines()
        cells = first.split(",")
        cells[2] = f"{float(cells[2]) + 0.001!r}"
        files["correspondences.csv"] = "\n".join([head, ",".join(cells), *rows]).encode()

    assert reproduce(archive(tmp_path, edit), tmp_path) == 1
    printed = capsys.readouterr().out
    for method in ("2d", "3d", "refined"):
        assert f"parameters_{method}.json: different" in printed
    assert "inputs.sha256" in printed


def test_a_forged_archive_cannot_bring_its_own_tolerance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What another process computes again is the same, as the test above shows."""
    again = {f"parameters_{name}.json": rig for name, rig in of_field().sets.items()}
    monkeypatch.setattr("stereocal.commands.reproduce._computed_again", lambda _: again)

    def edit(files: dict[str, bytes]) -> None:
        forged = json.loads(files["parameters_refined.json"])
        forged["baseline_m"] *= 1.5
        forged["predicted"]["median_error_3d"]["value"] *= 0.5
        files["parameters_refined.json"] = json.dumps(forged).encode()
        content = json.loads(files["reproduce.json"])
        entry = content["files"]["parameters_refined.json"]
        entry |= {"sha256": digest_of(forged), "tolerance": {"parameters": 0.99, "figures": 0.99}}
        files["reproduce.json"] = json.dumps(content).encode()

    assert reproduce(archive(tmp_path, edit), tmp_path) == 1
    printed = capsys.readouterr().out
    assert f"parameters_refined.json: different, in 2 values beyond the tolerance ({ADJUSTED})" in (
        printed
    )
    assert "baseline_m" in printed and "predicted.median_error_3d.value" in printed


BASE: dict[str, Any] = {
    "R": [[1.0, 0.0], [0.0, 1.0]],
    "cost": 2.0,
    "settings": {"seed": 3, "essential": "linear"},
    "frames_left_out": [1, 2],
    "recommendation": {"text": "Below 0.91 px, 0.60 %."},
    "created": "today",
    "validation": None,
}


def test_searched_sets_have_a_wider_tolerance() -> None:
    other = {**BASE, "R": [[1.0, 5e-5], [0.0, 1.0]], "cost": 2.05}
    assert len(differences(BASE, other, ADJUSTED)) == 2
    assert not differences(BASE, other, SEARCHED)


@pytest.mark.parametrize(("written", "equal"), [("6.1e-01", True), ("1e999", False)])
def test_numbers_of_a_sentence_may_differ_by_a_unit_of_their_last_digit(
    written: str, equal: bool
) -> None:
    texts = (f"Below 0.91 px, {number} %." for number in ("6.0e-01", written))
    one, other = ({**BASE, "recommendation": text} for text in texts)
    assert (differences(one, other, SEARCHED) == []) == equal
