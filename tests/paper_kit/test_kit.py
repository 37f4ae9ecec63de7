"""The kit holds what a paper needs, with the numbers of the result and nothing else."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest
import yaml

from stereocal.figures import journal
from stereocal.paper_kit.kit import paper_kit
from stereocal.paper_kit.methods_text import PAPER, PROGRAM, methods_md, references_bib
from stereocal.verdict.in_words import digits, interval, percent
from tests.paper_kit.answers import of_field

ROOT = Path(__file__).parents[2]


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
    assert use.threshold_px is not None and use.method == "refined"
    assert f"the refined set below {digits(use.threshold_px, 2)} px is recommended" in text
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
