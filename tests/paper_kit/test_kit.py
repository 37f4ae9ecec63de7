"""The kit holds what a paper needs, with the numbers of the result and nothing else."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from stereocal.calibration.methods import CalibrationSettings
from stereocal.cli import main
from stereocal.formats.dataset_files import read_dataset
from stereocal.matching.application import Outcome, digest_of
from stereocal.paper_kit.kit import paper_kit
from stereocal.paper_kit.methods_text import methods_md
from stereocal.paper_kit.references import PAPER, PROGRAM, references_bib
from stereocal.paper_kit.table import table_csv
from stereocal.rig.dataset import Dataset
from stereocal.verdict.in_words import digits, interval, percent
from tests.paper_kit.answers import FIELD, answer_of, of_field, of_recording

ROOT = Path(__file__).parents[2]


def detected(dataset: Dataset) -> Dataset:
    """As if two points were set by hand, and the others found in photographs."""
    source = np.zeros(len(dataset.correspondences), dtype=np.int64)
    source[:2] = 2
    return replace(dataset, correspondences=replace(dataset.correspondences, source=source))


def test_a_kit_holds_all_parts() -> None:
    with zipfile.ZipFile(io.BytesIO(paper_kit(of_field()))) as kit:
        names = set(kit.namelist())
        with zipfile.ZipFile(io.BytesIO(kit.read("archive.zip"))) as archive:
            archived = set(archive.namelist())
    drawn = ("validation", "validation_with_refined", "errors_by_frame", "rig")
    figures = {
        f"figures/{name}_{width}mm.{form}"
        for name in drawn
        for width in (88, 180)
        for form in ("svg", "pdf")
    }
    assert names == {"methods.md", "references.bib", "table.csv", "archive.zip", *figures}
    assert {"dataset.json", "correspondences.csv", "reproduce.json"} < archived
    assert {f"parameters_{method}.json" for method in ("2d", "3d", "refined")} < archived


def test_the_methods_say_the_figures_of_the_result() -> None:
    found = of_field()
    text = methods_md(found)
    assert found.evaluation is not None
    for summary in found.evaluation.summaries.values():
        fcp, median = summary.reprojection.fcp, summary.reconstruction.median
        assert f"{percent(fcp.value)} % ({interval(fcp)})" in text
        assert f"{percent(median.value)} % ({interval(median)})" in text
    use = found.recommendation.match
    assert use.threshold_px is not None
    assert use.method == "refined"
    assert f"the refined set below {digits(use.threshold_px, 2)} px is recommended" in text
    assert "points were matched" not in text and "were reconstructed" not in text
    for words in (
        "25 frames",
        "50 pairs",
        "25 bars",
        "0.9 m apart",
        "baseline was 4.5 m",
        "seed 0",
        "In each of 8 runs, 20 frames drawn at random calibrated the system and the other 5",
        f"[@{PAPER}]",
        f"[@{PROGRAM}]",
        "2336 × 1728 px",
        "10⁻⁶ rad",
        "the refined set",
    ):
        assert words in text, words
    assert "left out" not in text
    assert "  " not in text
    assert ".." not in text


def test_without_a_validation_it_says_less() -> None:
    text = methods_md(of_recording())
    for word in ("held-out", "runs", "FCP", "bootstrap", "(figure"):
        assert word not in text
    assert "in the forecast" in text
    assert "by the forecast, 95 % of lengths are within" in text
    left_out = of_recording().calibration.screening.left_out
    assert f"{len(left_out)} frames that contradicted the others" in text
    assert all(str(frame) in text for frame in left_out)


def test_without_a_forecast_it_says_what_is_recommended() -> None:
    settings = CalibrationSettings(frames_left_out=(3, 4), frames_put_back=(5,), essential="linear")
    text = methods_md(answer_of(detected(read_dataset(FIELD)), settings, runs=0))
    assert "Frames 3 and 4 were left out by hand. Frame 5 was kept by hand." in text
    assert "To match points, the 2D set is recommended." in text
    assert "To reconstruct positions and lengths, the 3D set is recommended." in text
    assert "eight-point algorithm" in text
    assert "refined" not in text
    assert "detected in the photographs; 2 pairs were corrected or set by hand." in text


def test_what_was_done_with_the_points_is_said_and_nothing_else() -> None:
    found = of_field()
    used = {
        "points": ["bats_left.csv", "bats_right.csv"],
        "matching": ["2d", digest_of(found.sets["2d"])],
        "measuring": ["3d", digest_of(found.sets["3d"])],
    }
    done = Outcome("", 0.955, [0.0, None], 600, 0, [], [], "", [], {}, used)
    text = methods_md(found, done)
    assert (
        "The points of `bats_left.csv` and `bats_right.csv` were matched with the 2D set below "
        "0.955 px. Their positions were reconstructed with the 3D set." in text
    )
    assert "recommended" not in text
    threshold = found.recommendation.match.threshold_px
    assert threshold is not None and f"{digits(threshold, 2)} px" not in text
    elsewhere = replace(done, used=used | {"matching": ["2d", "0" * 64]})
    assert "matched with the 2D set of another calibration" in methods_md(found, elsewhere)
    with zipfile.ZipFile(io.BytesIO(paper_kit(found, done))) as kit:
        assert kit.read("methods.md").decode().startswith(text)
    # A result of version 1.0 does not say with which sets it was made.
    assert methods_md(found, replace(done, used={})) == methods_md(found)


def test_a_caution_stands_first() -> None:
    found = of_field()
    doubted = replace(found, recommendation=replace(found.recommendation, caution="Half is wrong."))
    assert methods_md(doubted).startswith(
        "# Calibration\n\n**Do not rely on this result: Half is wrong.**\n"
    )


def test_the_table_is_that_of_the_summary() -> None:
    found = of_field()
    rows = {row["method"]: row for row in csv.DictReader(io.StringIO(table_csv(found).decode()))}
    assert list(rows) == ["essential", "2d", "3d", "refined"]
    assert found.evaluation is not None
    lengths = found.evaluation.summaries["3d"].reconstruction
    for end in ("value", "low", "high"):
        column = "median_error_3d" if end == "value" else f"median_error_3d_{end}"
        assert float(rows["3d"][column]) == getattr(lengths.median, end)
    forecast = found.forecasts["2d"].figures["threshold_px"]
    assert float(rows["2d"]["predicted_threshold_px_high"]) == forecast["high"]


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


def test_the_command_writes_a_kit(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["calibrate", str(FIELD), "--out", str(out), "--runs", "4", "--kit"]) == 0
    assert zipfile.is_zipfile(out / "paper_kit.zip")


def test_a_kit_of_foreign_figures_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--kit", "--validation", str(tmp_path / "summary.json")]
    assert main(["calibrate", str(FIELD), "--out", str(tmp_path / "out"), *asked]) == 2
    assert "give --kit or --validation" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_matplotlib_is_imported_for_a_kit_only() -> None:
    code = "import stereocal.cli, stereocal.ui.results, sys; print('matplotlib' in sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "False"
