"""Points of three cameras: which belong together, and where they are."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from stereocal.cli import main
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.views import EACH
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.formats.world_file import read_world
from stereocal.library.tables import match, reconstruct
from stereocal.matching.clicks import CLICK_PX, Click, ClickMeasure, Clicks
from stereocal.matching.match_tables import match_tables
from stereocal.matching.point_table import PointTable
from stereocal.matching.settled import Stated
from stereocal.matching.tables_by_camera import Report
from stereocal.matching.view_groups import ViewFitter, expected_wrong, match_views
from stereocal.matching.views import cameras_of
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.geometry import Pose
from stereocal.simulation.rigs import SimulatedRig, simulated_rig
from stereocal.system.array_types import FloatArray, IntArray
from tests.matching.test_clicks import LENGTH_M, agrees, of_independent, off

NOISE = 0.3


@pytest.fixture(scope="module")
def truth() -> SimulatedRig:
    return simulated_rig(np.random.default_rng(5), 3, 150)


@pytest.fixture(scope="module")
def rig(truth: SimulatedRig) -> RigFile:
    return rig_file(calibrate_rig(truth.recording, truth.settings))


def scene(
    truth: SimulatedRig,
    rng: np.random.Generator,
    count: int,
    cameras: int = 3,
    extent_m: float = 1.2,
) -> tuple[FloatArray, list[FloatArray], list[IntArray]]:
    """Points, their images in each camera, of which 5 % are missing, and which point each is."""
    middle = truth.points_m.reshape(-1, 3).mean(axis=0)
    points = middle + rng.uniform(-extent_m, extent_m, (count, 3))
    images, which = [], []
    for number, (name, camera) in enumerate(truth.cameras.items()):
        pixels = camera.project(truth.poses[name].apply(points))
        pixels += rng.normal(0.0, NOISE, pixels.shape)
        size = np.array(camera.image_size) - 1
        seen = ((pixels > 0) & (pixels < size)).all(axis=1) & (rng.random(count) > 0.05)
        seen &= number < cameras
        images.append(pixels[seen])
        which.append(np.flatnonzero(seen))
    return points, images, which


def frames_of(
    truth: SimulatedRig, rig: RigFile, cameras: int
) -> tuple[ViewFitter, list[list[FloatArray]], float]:
    """8 frames of 60 points, and which share of groups with all views is wrong."""
    fitter, rng = ViewFitter(rig), np.random.default_rng(1)
    wrong, frames = [], []
    for _ in range(8):
        _, images, which = scene(truth, rng, 60, cameras)
        frames.append(images)
        found = match_views(fitter, images, NOISE)
        for group in found.images[found.views == cameras]:
            ids = {which[c][image] for c, image in enumerate(group) if image >= 0}
            wrong.append(len(ids) > 1)
    return fitter, frames, float(np.mean(wrong))


def test_a_third_view_decides(truth: SimulatedRig, rig: RigFile) -> None:
    # 40 points: two cameras 4.4 % wrong, three 0 of 687; 80 points: 7.7 % and 0.07 %
    assert frames_of(truth, rig, 2)[2] > 0.04
    fitter, frames, wrong = frames_of(truth, rig, 3)
    assert wrong <= 0.005
    unnamed = [[np.zeros(len(own), dtype=np.int64) for own in images] for images in frames]
    assert expected_wrong(fitter, frames, NOISE, unnamed).get(3, 0.0) <= 0.01


def test_images_of_nothing_belong_to_nothing(truth: SimulatedRig, rig: RigFile) -> None:
    fitter, rng = ViewFitter(rig), np.random.default_rng(2)
    _, one, _ = scene(truth, rng, 10)
    found = match_views(fitter, [one[0], np.empty((0, 2)), np.empty((0, 2))], NOISE)
    assert len(found) == 0
    assert len(match_views(fitter, [np.empty((0, 2))] * 3, NOISE)) == 0


def tables_of(
    truth: SimulatedRig, rng: np.random.Generator, frames: int, count: int, extent_m: float = 1.2
) -> tuple[dict[str, pd.DataFrame], dict[int, FloatArray]]:
    """Tables of all cameras, with the number of each point, and the points of each frame."""
    rows, points = {name: list[pd.DataFrame]() for name in truth.cameras}, {}
    for frame in range(frames):
        points[frame], images, which = scene(truth, rng, count, extent_m=extent_m)
        for own, pixels, ids in zip(rows.values(), images, which, strict=True):
            u, v = pixels.T
            own.append(pd.DataFrame({"frame": frame, "u": u, "v": v, "truth": ids}))
    return {name: pd.concat(own) for name, own in rows.items()}, points


def matched(
    truth: SimulatedRig, rig: RigFile, folder: Path, names: str = "auto", turned: int = 0
) -> tuple[Report, pd.DataFrame]:
    """30 points within 10 cm in each of 6 frames; the third camera's names are `turned`."""
    tables, _ = tables_of(truth, np.random.default_rng(8), 6, 30, 0.05)
    for name, own in tables.items():
        number = (own["truth"] + turned * (name == "c3")) % 30
        own["point"] = "P" + number.astype(str)
    given = {name: PointTable(own) for name, own in tables.items()}
    report = match_tables(rig, given, folder / "tracks.csv", Stated(names=names))
    return report, pd.read_csv(folder / "tracks.csv")


def joined_wrong(tracks: pd.DataFrame, column: str = "truth") -> float:
    """The share of rows that join images of different points."""
    own = tracks.filter(regex=f"^{column}_").to_numpy(dtype=object)
    return float(np.mean([len({*row[~pd.isna(row)]}) > 1 for row in own]))


def test_only_points_of_one_name_belong_together(
    truth: SimulatedRig, rig: RigFile, tmp_path: Path
) -> None:
    report, tracks = matched(truth, rig, tmp_path, "none")
    assert joined_wrong(tracks) > 0.1 and not report.names.columns  # measured: 44 of 177
    report, tracks = matched(truth, rig, tmp_path)
    assert report.names.columns == ("point",) and joined_wrong(tracks) == 0
    # 95 % are seen by each camera: 179 of 180 by two and more; measured: 159, 177
    assert (tracks["views"] == 3).sum() > 150 and len(tracks) > 174


def test_named_points_that_keep_still_are_not_wrong(truth: SimulatedRig, rig: RigFile) -> None:
    _, images, which = scene(truth, np.random.default_rng(9), 30)
    names = [own + 1 for own in which]
    wrong = expected_wrong(ViewFitter(rig), [images] * 6, NOISE, [names] * 6)
    assert wrong[3] < 0.1  # none; by images of one name in other frames, all


def test_names_that_a_camera_counts_for_itself_do_not_decide(
    truth: SimulatedRig, rig: RigFile, tmp_path: Path
) -> None:
    _, without = matched(truth, rig, tmp_path, "none", turned=1)
    report, tracks = matched(truth, rig, tmp_path, turned=1)
    assert report.names.columns == () and joined_wrong(tracks) == joined_wrong(without)
    assert any("c3" in note and "do not fit the images" in note for note in report.notes)
    report, tracks = matched(truth, rig, tmp_path, "point", turned=1)
    assert joined_wrong(tracks, "point") == 0


def test_the_commands(
    truth: SimulatedRig, rig: RigFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tables, true = tables_of(truth, np.random.default_rng(3), 30, 15)
    alone = pd.DataFrame({"frame": [30], "u": [5.0], "v": [5.0]})  # without partner
    tables["c1"] = pd.concat([tables["c1"], alone])
    given = []
    for name, own in tables.items():
        own[["frame", "u", "v"]].to_csv(tmp_path / f"{name}.csv", index=False)
        given.append(f"{name}={tmp_path / name}.csv")
    (tmp_path / "rig.json").write_text(rig.dumps())
    files = ["--rig", str(tmp_path / "rig.json"), "--out"]
    lost = ["--unmatched", str(tmp_path / "lost.csv")]
    assert main(["match", *given, *files, str(tmp_path / "tracks.csv"), *lost]) == 0
    told = capsys.readouterr().out
    assert "wrong" in told
    tracks = pd.read_csv(tmp_path / "tracks.csv")
    assert {"u_c1", "v_c3", "views", "error_px", "ambiguous"} <= {*tracks.columns}
    assert (tracks["views"] == 3).mean() > 0.6
    left = pd.read_csv(tmp_path / "lost.csv")
    assert list(left) == ["camera", "frame", "u", "v"] and (left["camera"] == "c1").any()
    assert len(left) + tracks["views"].sum() == sum(map(len, tables.values()))

    tracks_file = str(tmp_path / "tracks.csv")
    assert main(["reconstruct", tracks_file, *files, str(tmp_path / "points.csv")]) == 0
    both = [re.search(r"scatter by ([\d.]+) px", told)]
    both += [re.search(r"known to ([\d.]+) px", capsys.readouterr().out)]
    first, second = (float(found[1]) for found in both if found)
    # one noise, that of 446 points; measured 0.31, by two of the cameras alone 0.29
    assert first == second == pytest.approx(NOISE, rel=0.05)
    points = pd.read_csv(tmp_path / "points.csv")
    z = []
    for row in points[points["views"] == 3].to_dict("records"):
        error = np.array([row[name] for name in "xyz"]) - true[int(row["frame"])]
        nearest = error[np.linalg.norm(error, axis=1).argmin()]
        z.append(nearest / [row[f"sigma_{name}"] for name in "xyz"])
    # the errors of the cameras are common to all points: rms of z of this rig 0.9
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.5

    # of an earlier version, whose rigs could be of the files of their pairs, without a recording
    content = rig.to_json()
    about = ("inputs", "figures", "image_errors_px", "wrong_images", "loops", "third_camera_px")
    for entry in (*about, "not_connected", "warnings"):
        del content[entry]
    for pair in content["pairs"].values():
        pair["chi_square_growth"] = 3.5
    content |= {"volume": None, "object": {"factor": 1.0}}
    (tmp_path / "rig.json").write_text(json.dumps(content))
    assert main(["match", *given, *files, str(tmp_path / "old.csv")]) == 0
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "old.csv"), tracks)
    assert main(["reconstruct", tracks_file, *files, str(tmp_path / "old.csv")]) == 0
    old = pd.read_csv(tmp_path / "old.csv")
    assert np.array_equal(old[["x", "y", "z"]], points[["x", "y", "z"]])


def test_a_world_frame_by_two_of_the_cameras(
    truth: SimulatedRig, rig: RigFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Points surveyed with the second and third camera of a rig that is known exactly; the first
    sees one of them."""
    rig = replace(rig, cameras=truth.cameras, poses=truth.poses)
    rng, (first, *both) = np.random.default_rng(4), truth.cameras
    world = Pose(Rotation.from_euler("xyz", [-1.4, 0.1, 0.6]).as_matrix(), np.array([5.0, 2, 1.5]))
    middle = truth.points_m.reshape(-1, 3).mean(axis=0)
    xyz = middle + rng.uniform(-0.8, 0.8, (40, 3))
    table = pd.DataFrame(world.apply(xyz), columns=list("xyz"))
    table.insert(0, "point", [f"P{k}" for k in range(len(xyz))])
    inside = np.ones(len(xyz), dtype=bool)
    for name in truth.cameras:
        camera = truth.cameras[name]
        pixels = camera.project(truth.poses[name].apply(xyz))
        inside &= ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=1)
        table[[f"u_{name}", f"v_{name}"]] = pixels + rng.normal(0.0, NOISE, pixels.shape)
    seen = table[inside][:12]
    seen.loc[seen.index[1:], [f"u_{first}", f"v_{first}"]] = np.nan
    seen.to_csv(tmp_path / "survey.csv", index=False)
    (tmp_path / "rig.json").write_text(rig.dumps())
    files = ["--rig", str(tmp_path / "rig.json"), "--out", str(tmp_path / "world.json")]
    assert main(["world", str(tmp_path / "survey.csv"), *files]) == 0
    assert f"Camera {both[0]} stands at" in capsys.readouterr().out
    # Root mean square of points 5 m away, seen with 0.3 px. Measured: 0.7 mm.
    off = read_world(tmp_path / "world.json").apply(xyz) - world.apply(xyz)
    assert np.sqrt(np.mean(np.square(off))) < 0.002
    seen.drop(columns=[f"u_{name}" for name in both]).to_csv(tmp_path / "one.csv", index=False)
    assert main(["world", str(tmp_path / "one.csv"), *files]) == 2
    assert "the pixels of two cameras of the rig are needed" in capsys.readouterr().err


def test_a_rig_of_two_cameras_may_lack_one_whatever_they_are_called(
    truth: SimulatedRig, rig: RigFile
) -> None:
    """A row of a pair has both; of a rig, one that lacks a camera has no point."""
    names = dict(zip(("c1", "c2"), CAMERAS, strict=True))
    two = replace(
        rig,
        cameras={to: rig.cameras[name] for name, to in names.items()},
        poses={to: rig.poses[name] for name, to in names.items()},
        time_offsets=dict.fromkeys(CAMERAS, 0.0),
        covariance=rig.covariance[: 2 * EACH + 1, : 2 * EACH + 1],
    )
    point = truth.points_m.reshape(-1, 3).mean(axis=0)[None]
    seen = [truth.cameras[n].project(truth.poses[n].apply(point))[0] for n in names]
    row = dict(zip(PIXELS, np.concatenate(seen).tolist(), strict=True))
    table = pd.DataFrame([{"frame": 0, **row}, {"frame": 1, **row, "u_secondary": np.nan}])
    table.loc[1, "v_secondary"] = np.nan
    found = reconstruct(two, table)
    assert np.isfinite(found["x"]).tolist() == [True, False]


def test_wrong_input_of_the_commands(rig: RigFile, tmp_path: Path) -> None:
    (tmp_path / "rig.json").write_text(rig.dumps())
    (tmp_path / "a.csv").write_text("frame,u,v\n0,10,10\n")
    table = str(tmp_path / "a.csv")
    files = ["--rig", str(tmp_path / "rig.json"), "--out", str(tmp_path / "out.csv")]
    for words in (
        ["match", f"c1={table}", f"nobody={table}", *files],
        ["match", f"c1={table}", table, *files],
        ["match", f"c1={table}", f"c1={table}", *files],
        ["match", f"c1={table}", f"c2={table}", "--threshold", "2", *files],
        ["match", f"c1={table}", f"c2={table}", "--names", "limb", *files],
        ["reconstruct", table, *files],
    ):
        assert main(words) == 2, words
        assert not (tmp_path / "out.csv").exists()


def test_a_clicked_point_of_three_cameras_needs_two_of_them(
    truth: SimulatedRig, rig: RigFile
) -> None:
    rng = np.random.default_rng(1)
    middle = truth.points_m.reshape(-1, 3).mean(axis=0)
    head = middle + np.outer(np.arange(12) - 6, [0.03, 0.01, 0.02])
    points = {"head": head, "tail": head + np.array([0.0, LENGTH_M, 0.0])}
    images = {
        name: {
            track: camera.project(truth.poses[name].apply(own)) + rng.normal(0.0, NOISE, (12, 2))
            for track, own in points.items()
        }
        for name, camera in truth.cameras.items()
    }
    clicks = Clicks.of(
        Click(frame, camera, track, *pixels[frame].tolist())
        for camera, tracks in images.items()
        for track, pixels in tracks.items()
        for frame in range(12)
        if (camera, track, frame) != ("c2", "head", 3)
    )
    how = ClickMeasure(rig, rig)
    settled = how.settled(clicks)
    assert 0.2 < settled.sigma_px < 0.45  # truth: 0.3
    found = how.measured(clicks, settled)
    assert cameras_of(found.pixels).tolist() == [3] * 6 + [2] + [3] * 17
    tracks = match(rig, clicks.tables(rig.names), names="track")
    agrees(found, reconstruct(rig, tracks, sigma_px=settled.sigma_px))
    assert not any(found.beyond(frame) for frame in range(12))
    length = found.length(*found.common("head", "tail"))
    assert length is not None and abs(length.metres - LENGTH_M) < 3 * length.sigma_m < 0.01
    independent = of_independent(found, *found.common("head", "tail"))
    assert length.sigma_m == pytest.approx(independent, rel=0.01)
    two = how.measured(Clicks.of(e for e in clicks.every.values() if e.camera != "c3"), settled)
    worse = two.length(*two.common("head", "tail"))
    assert worse is not None and worse.sigma_m > 1.1 * length.sigma_m
    wrong = clicks.placed([replace(clicks.every[5, "c3", "tail"], u=400.0)])
    assert how.measured(wrong, settled).beyond(5) == {"tail"}
    for camera, track, frame in (("c1", "head", 2), ("c3", "tail", 7)):
        click = clicks.every[frame, camera, track]
        for other in {*rig.names} - {camera}:
            assert off(how.curve(click, other), images[other][track][frame]) < 3.0
    few = Clicks.of(each for each in clicks.every.values() if each.frame < 4)
    assert how.settled(few) == (CLICK_PX, 0.0)
