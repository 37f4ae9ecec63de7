"""`import`: data sets from files of other programs, on the command line."""

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.correspondences_csv import read_table
from stereocal.formats.dataset_files import pack_dataset, read_dataset, read_recording
from stereocal.rig.parameters import RigParameters
from tests.archives import easywand_fields, mat
from tests.files import write, zipped
from tests.rigs.known_rig import BASELINE_M
from tests.rigs.known_rig import dataset as known_dataset

EUROPEAN = Path(__file__).parents[1] / "cases" / "european_wand_table"


@pytest.fixture
def easywand(tmp_path: Path) -> Path:
    fields = easywand_fields(20, more_cameras=1)
    fields |= {"axisPts": fields["backgroundPts"], "gravityFreq": 250.0}
    path = tmp_path / "flight_easyWandData.mat"
    path.write_bytes(mat({"easyWandData": fields}))
    return path


def test_easywand(easywand: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "set"
    assert main(["import", str(easywand), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "39 pairs of points" in said and "250 frames a second" in said
    assert "nominal: not a measurement" in said and "3 cameras" in said
    names = {"THROW.csv", "correspondences.csv", "dataset.json", "primary.json", "secondary.json"}
    assert {path.name for path in out.iterdir()} == names
    assert (out / "THROW.csv").read_text().startswith("frame,u_primary,v_primary,u_secondary,")
    found = read_dataset(out)
    assert found.baseline_m == pytest.approx(BASELINE_M)
    assert found.baseline_sigma_m == pytest.approx(0.02 * BASELINE_M)
    assert "not a measurement" in found.notes


def test_lengths_and_sizes_that_cannot_be_are_refused(
    easywand: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    every = ["--cameras", "all"]
    for words, message in (
        (["--baseline", "5000"], "baseline is 5000 m"),
        ([*every, "--distance", "5000"], "targets is 5000 m"),
        ([*every, "--image-size", "64x48"], "outside the 64x48 px image"),
    ):
        assert main(["import", str(easywand), *words, "--out", str(tmp_path / "set")]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_what_is_no_data_set_or_one_already_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = pack_dataset(known_dataset(4))
    european, packed = files["correspondences.csv"].replace(b",", b";"), zipped(files)
    both = zipped({"day/set.zip": packed})
    write({"table.csv": european, "both.zip": both, "set.zip": packed}, tmp_path)
    for command, name, says in (
        ("calibrate", "table.csv", "stereocal import"),
        ("calibrate", "both.zip", "the zip day/set.zip: unpack that"),
        ("import", "set.zip", "dataset.json: this is a data set already"),
    ):
        assert main([command, str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
        assert says in capsys.readouterr().err


def test_files_in_a_zip_are_imported(tmp_path: Path) -> None:
    files = {path.name: path.read_bytes() for path in EUROPEAN.iterdir()}
    names = ("wand.csv", "l.yml", "r.yml")
    (tmp_path / "day.zip").write_bytes(zipped({f"day/{name}": files[name] for name in names}))
    lengths = ["--baseline", "1.2176", "--distance", "0.5", "--out", str(tmp_path / "set")]
    assert main(["import", str(tmp_path / "day.zip"), *lengths]) == 0
    assert len(read_dataset(tmp_path / "set").correspondences.bars) == 25


def test_a_free_baseline(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exact = known_dataset(25, 0.1)
    folder, wrong = tmp_path / "set", 3.1
    write(pack_dataset(exact), folder)
    about = json.loads((folder / "dataset.json").read_text())
    about |= {"baseline_m": wrong, "baseline_sigma_m": "free"}
    (folder / "dataset.json").write_text(json.dumps(about))
    found = pair_to_calibrate(read_recording(folder))
    assert found.baseline_is_free
    assert found.baseline_m == pytest.approx(BASELINE_M, rel=0.01)
    packed = pack_dataset(found)
    assert b'"baseline_sigma_m": "free"' in packed["dataset.json"]
    write(packed, folder)
    assert pair_to_calibrate(read_recording(folder)).sha256 == found.sha256
    capsys.readouterr()
    out = tmp_path / "parameters"
    assert main(["calibrate", str(folder), "--out", str(out), "--runs", "0"]) == 0
    assert "cannot solve for a baseline" in capsys.readouterr().out
    for name in ("2d", "3d", "refined"):
        rig = RigParameters.load(out / f"parameters_{name}.json")
        assert rig.pose.baseline == pytest.approx(BASELINE_M, rel=0.01)
        assert "not measured" in rig.inputs["baseline"]


class TestTablesOfAnyCountry:
    """Decimal commas, semicolons, tabs, a blank first line, Excel's `sep=`: the same 50 pairs."""

    FILES = ("blank_first.csv", "sep.csv", "tab_comma.tsv", "wand.csv")

    @staticmethod
    def run(table: str, out: Path) -> int:
        lenses = [str(EUROPEAN / name) for name in ("l.yml", "r.yml")]
        lengths = ["--baseline", "1.2176", "--distance", "0.5", "--out", str(out)]
        return main(["import", str(EUROPEAN / table), *lenses, *lengths])

    def test_are_read_alike(self, tmp_path: Path) -> None:
        for table in self.FILES:
            assert self.run(table, tmp_path / table) == 0
        first, *others = (
            read_table((tmp_path / table / "correspondences.csv").read_bytes(), table).strict(table)
            for table in self.FILES
        )
        assert len(first.bars) == 25 and first.primary[0].tolist() == [1215.883, 618.4661]
        for other in others:  # the wand's numbers have three decimals
            order = np.lexsort([other.target, other.frame])
            for side in ("primary", "secondary"):
                found, expected = getattr(other, side)[order], getattr(first, side)
                np.testing.assert_allclose(found, expected, rtol=0, atol=6e-4)

    def test_the_message_names_the_option(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        files = [str(EUROPEAN / name) for name in ("wand.csv", "l.yml", "r.yml")]
        assert main(["import", *files, "--cameras", "all", "--out", str(tmp_path / "set")]) == 2
        assert "Use --cameras 1,2" in capsys.readouterr().err

    def test_commas_for_both_are_refused(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert self.run("comma_comma.csv", tmp_path / "set") == 2
        assert "4 cameras" in capsys.readouterr().err
