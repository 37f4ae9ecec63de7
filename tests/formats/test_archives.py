"""Data sets from files of other programs: easyWand, MATLAB, Kalibr, aniposelib, Caliscope, ..."""

from typing import Any

import numpy as np
import pytest

from stereocal.formats.archives.archive import Archive
from stereocal.formats.archives.gather import bars_of, gather, layout_of_bars
from stereocal.formats.camera_file import write_camera
from stereocal.formats.exchange.exchange import export_files, import_files
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.rig.camera import Camera
from stereocal.rig.parameters import RigParameters
from tests.archives import (
    PLAIN,
    caliscope_files,
    easywand_camera,
    easywand_fields,
    kalibr_chain,
    mat,
    stereo_struct,
    wand_csv,
)
from tests.refused import refused
from tests.rigs.known_rig import BAR_M, BASELINE_M, PRIMARY, RIG, SECONDARY

USUAL = ExchangeOptions()


def easywand(options: ExchangeOptions = USUAL, **changed: Any) -> Archive:
    fields = {**easywand_fields(), **changed}
    return gather({"calib.mat": mat({"easyWandData": fields})}, options)


def same_cameras(found: Archive | RigParameters, *cameras: Camera) -> None:
    for own, wanted in zip((found.primary, found.secondary), cameras, strict=True):
        assert own is not None
        corners = np.array([[0.0, 0.0], [wanted.image_size[0] - 1.0, 50.0], [300.0, 700.0]])
        assert own.image_size == wanted.image_size
        assert np.abs(own.undistort(corners) - wanted.undistort(corners)).max() < 1e-9


def test_easywand_gives_the_same_data_set_as_our_csv() -> None:
    cameras = [easywand_camera(PRIMARY), easywand_camera(SECONDARY)]
    files = dict(zip(("a.json", "b.json"), map(write_camera, cameras), strict=True))
    csv = gather({"wand.csv": wand_csv(), **files}, USUAL)
    found = easywand(backgroundPts=np.zeros((0, 0)))
    assert found.correspondences is not None and csv.correspondences is not None
    for name in ("frame", "target", "primary", "secondary"):
        ours, theirs = getattr(csv.correspondences, name), getattr(found.correspondences, name)
        assert np.array_equal(ours, theirs)
    assert len(found.correspondences) == 23
    same_cameras(found, *cameras)
    measured = [each.dataset("x", BASELINE_M, BAR_M) for each in (csv, found)]
    rays = [dataset.rays for dataset in measured]
    assert np.abs(rays[0] - rays[1]).max() < 1e-12


def test_a_height_that_the_points_contradict_is_asked_for() -> None:
    with refused("calib.mat", "1600x800", "cam1", "844") as e:
        easywand(imageHeight=np.array([800.0, 1024.0]))
    assert "640x512" in e.value.option
    stated = ExchangeOptions(((1600, 1200), (1600, 1200)))
    found = easywand(stated, imageHeight=np.array([800.0, 1024.0]))
    rows, wanted = found.correspondences, easywand().correspondences
    assert rows is not None and wanted is not None
    assert np.array_equal(rows.primary, wanted.primary)


def test_the_unit_of_lengths() -> None:
    with refused("calib.mat", "870 m", "unit") as e:
        easywand(wandLen=870.0)
    assert "--unit" in e.value.option
    found = easywand(ExchangeOptions(unit="mm"), wandLen=870.0)
    assert found.target_distance_m == pytest.approx(0.87)
    assert found.baseline_m == pytest.approx(BASELINE_M / 1000)


def test_matlab_stereo_parameters() -> None:
    content = mat({"s": stereo_struct()})
    found = gather({"stereo.mat": content, "wand.csv": wand_csv()}, USUAL)
    same_cameras(found, PRIMARY, SECONDARY)
    assert found.baseline_m == pytest.approx(BASELINE_M)
    imported = import_files({"stereo.mat": content}, "matlab")
    same_cameras(imported, PRIMARY, SECONDARY)
    assert np.abs(imported.pose.T - RIG.T).max() < 1e-12
    newer = stereo_struct()
    del newer["RotationOfCamera2"], newer["TranslationOfCamera2"]
    pose = np.vstack([np.column_stack([RIG.R, RIG.T]), [0, 0, 0, 1]])
    newer["PoseCamera2"] = {"Dimensionality": 3.0, "A": np.linalg.inv(pose)}
    newer["RotationOfCamera2"], newer["WorldUnits"] = np.zeros((0, 0)), np.zeros((0, 0))
    found = gather({"stereo.mat": mat({"s": newer}), "wand.csv": wand_csv()}, USUAL)
    assert found.baseline_m == pytest.approx(BASELINE_M)
    del newer["PoseCamera2"]
    assert gather({"stereo.mat": mat({"s": newer})}, USUAL).baseline_m is None


@pytest.mark.parametrize("name", ["kalibr", "ros", "opencv", "matlab", "aniposelib"])
def test_cameras_of_each_program_with_a_wand_table(name: str) -> None:
    found = gather({"wand.csv": wand_csv(), **export_files(PLAIN, name)}, USUAL)
    same_cameras(found, PLAIN.primary, PLAIN.secondary)
    assert found.baseline_m == pytest.approx(BASELINE_M)
    dataset = found.dataset("x", None, BAR_M)
    assert len(dataset.correspondences.bars) == 11
    pose = dataset.reconstructed_lengths_m(RIG)
    assert np.median(np.abs(pose - BAR_M)) < 0.02


def test_caliscope_of_both_versions() -> None:
    newer, older = caliscope_files()
    for content, name in ((newer, "camera_array.toml"), (older, "config.toml")):
        options = ExchangeOptions(cameras=("1", "3"), unit="m")
        found = gather({name: content}, options)
        same_cameras(found, PRIMARY, SECONDARY)
        assert found.baseline_m == pytest.approx((RIG @ RIG).baseline)  # RIG from its own inverse
        assert "Caliscope" in found.taken[0].origin


def test_the_ends_of_the_bar_are_chosen() -> None:
    read = bars_of(wand_csv(), "w.csv", ExchangeOptions(ends=("B", "A")), (1200, 1024))
    usual = bars_of(wand_csv(), "w.csv", USUAL, (1200, 1024))
    assert np.array_equal(
        read.rows.primary[read.rows.target == 0], usual.rows.primary[usual.rows.target == 1]
    )
    with refused("w.csv: ", "ends", "(A)"):
        bars_of(wand_csv(), "w.csv", ExchangeOptions(ends=("A", "A")), (1200, 1024))
    with refused("w.csv: ", "lower left", "height"):
        bars_of(wand_csv(), "w.csv", USUAL, (1200, None))


def test_three_cameras_of_kalibr_in_either_order() -> None:
    files, twice = {"c.yaml": kalibr_chain()}, pytest.approx((RIG @ RIG).baseline)
    for cameras in (("1", "3"), ("3", "1")):
        options = ExchangeOptions(cameras=cameras)
        assert gather(files, options).baseline_m == twice
        assert import_files(files, "kalibr", options).pose.baseline == twice
    assert gather(files, USUAL).baseline_m == pytest.approx(BASELINE_M)
    files["wand.csv"] = wand_csv()  # the table has two cameras
    found = gather(files, ExchangeOptions(cameras=("1", "3")))
    assert any("for the camera files only" in remark for remark in found.remarks)
    assert found.correspondences is not None and len(found.correspondences) == 23


def test_the_middle_of_a_wand_is_not_taken_for_an_end() -> None:
    names = [f"cam{c}_{p}_{a}" for c in (1, 2) for p in ("tip", "middle", "base") for a in "xy"]
    table = "frame," + ",".join(names) + "\n" + "0,1,2,3,4,5,6,7,8,9,10,11,12\n" * 2
    assert layout_of_bars(table.encode(), "w.csv", ExchangeOptions())[1] == ("tip", "base")
