"""The kit holds what a paper needs; its data set and parameter files open as any others."""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from stereocal.cli import main
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.formats.dataset_files import read_dataset
from stereocal.paper_kit.kit import paper_kit
from stereocal.paper_kit.methods_text import PAPER, PROGRAM, methods_md, references_bib
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import unzip
from stereocal.verdict.in_words import digits, in_percent
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.fit.test_time_offset import moving
from tests.terminal import FIELD, ROOT

TEXTS = {"methods.md", "references.bib", "table.csv"}
DATA = {"dataset.json", "primary.json", "secondary.json", "correspondences.csv"}


@cache
def of_field() -> PairAnswer:
    """With a validation of few runs."""
    run = PairRun(read_dataset(FIELD))
    settings = EvaluationSettings(runs=4, calibration_frames=20, refined=run.refined)
    with ThreadPoolExecutor(2) as executor:
        return PairAnswer(run, run.validate(settings, executor))


def test_a_kit_holds_all_parts_and_the_command_line_opens_it(tmp_path: Path) -> None:
    """Poses found again are equal to 1e-6: where all is compiled anew, rounding differs by 1e-8."""
    found, kit, again = of_field(), tmp_path / "paper_kit.zip", tmp_path / "again"
    kit.write_bytes(paper_kit(found))
    files = unzip(kit, kit.name)
    sets = {f"parameters_{method}.json": rig for method, rig in found.sets.items()}
    assert len(sets) == 3 and files.keys() == TEXTS | DATA | sets.keys()
    assert main(["calibrate", str(kit), "--runs", "0", "--out", str(again)]) == 0
    for name, rig in sets.items():
        opened = RigParameters.loads(files[name])
        computed = RigParameters.loads((again / name).read_bytes())
        for other in (opened, computed):
            assert other.inputs["sha256"] == rig.inputs["sha256"]
            np.testing.assert_allclose(other.pose.R, rig.pose.R, atol=1e-6)
            np.testing.assert_allclose(other.pose.T, rig.pose.T, atol=1e-6)


def test_the_methods_say_that_the_secondary_points_were_shifted() -> None:
    text = methods_md(PairAnswer(PairRun(moving(0.3))))
    assert "later than the primary. Its points were interpolated" in text
    assert "interpolated" not in methods_md(of_field())


def test_the_methods_say_the_figures_of_the_result() -> None:
    found = of_field()
    text = methods_md(found)
    assert found.evaluation is not None
    for summary in found.evaluation.summaries.values():
        fcp, median = (summary.main(name) for name in ("reprojection", "reconstruction"))
        assert f"an FCP of {in_percent(fcp)} and a median 3D error of {in_percent(median)}," in text
        assert not summary.has_intervals
    use = found.recommendation.match
    assert use.threshold_px is not None and use.method == "refined"
    below = f"below {digits(use.threshold_px, 2)} px (held-out frames)"
    assert f"the refined set {below} is recommended" in text
    for words in (
        *("25 frames", "50 pairs", "25 bars", "0.9 m apart", "baseline was 4.5 m", "seed 0"),
        "In each of 4 runs, 20 frames drawn at random calibrated the system and the other 5",
        *(f"[@{PAPER}]", f"[@{PROGRAM}]", "2336 × 1728 px", "10⁻⁶ rad", "the refined set"),
    ):
        assert words in text, words
    for words in (
        "left out",
        "95 % bootstrap",
        "  ",
        "..",
        "points were matched",
        "were reconstructed",
    ):
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
