"""Files that pages of the documentation name, and that no command of theirs makes.

`python -m tests.docs.prepared` makes the samples `archives`, `bump` and `world` again.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.system.photograph import read_photograph
from tests.archives import easywand_fields, kalibr_chain, mat, wand_csv
from tests.field.world_tables import PIXELS, lines_csv, survey_csv, throw_csv
from tests.files import write
from tests.rigs.worlds import common_view, known_places, plumb_lines, surveyed, thrown
from tests.terminal import ROOT
from tools.photographs.videos import write_video

SAMPLES = ROOT / "sample_data"


def archives(folder: Path) -> None:
    """A file of easyWand; a wand table with the lenses of Kalibr."""
    fields = easywand_fields(20, more_cameras=1)
    (folder / "flight_easyWandData.mat").write_bytes(mat({"easyWandData": fields}))
    (folder / "wand.csv").write_bytes(wand_csv(20))
    (folder / "camchain.yaml").write_bytes(kalibr_chain())


def videos(folder: Path) -> None:
    """A data set without points, and six seconds of two videos."""
    sample = SAMPLES / "photographs"
    (folder / "pond").mkdir()
    for name in ("dataset.json", "primary.json", "secondary.json"):
        (folder / "pond" / name).write_bytes((sample / name).read_bytes())
    for camera in ("primary", "secondary"):
        images = [read_photograph(sample / camera / f"{frame:04d}.jpg") for frame in range(1, 7)]
        write_video(folder / f"{camera}.mp4", range(6), draw=images.__getitem__, preset="ultrafast")


def world(folder: Path) -> None:
    """A survey, plumb lines and a throw of one place, its parameters, and pairs."""
    place = next(known_places(1, 21))
    replace(place.rig, method="3d").save(folder / "parameters_3d.json")
    (folder / "survey.csv").write_bytes(survey_csv(surveyed(place, 5)))
    (folder / "plumb.csv").write_bytes(lines_csv(plumb_lines(place)))
    (folder / "throw.csv").write_bytes(throw_csv(thrown(place)))
    points = np.array([common_view(place, 6.0) for _ in range(10)])
    pairs = pd.DataFrame(place.images(points, 0.3), columns=PIXELS)
    pairs.insert(0, "frame", range(1, 11))
    pairs.to_csv(folder / "pairs.csv", index=False)


def bump(folder: Path) -> None:
    """40 bars of the real recording, after the secondary camera turned by 0.2° in place."""
    whole = read_dataset(SAMPLES / "recording")
    some = whole.of_frames(whole.correspondences.frames[200::5][:40])
    camera, rows = some.secondary, some.correspondences
    turn = Rotation.from_rotvec([0.0, np.radians(0.2), 0.0]).as_matrix()
    rays = np.column_stack([camera.undistort(rows.secondary), np.ones(len(rows))]) @ turn.T
    secondary = np.round(camera.distort(rays[:, :2] / rays[:, 2:]), 4)
    moved = some.changed(
        name="After a bump",
        correspondences=replace(rows, secondary=secondary),
        notes="40 bars of the real recording, its secondary camera turned by 0.2 degrees.",
    )
    write(pack_dataset(moved), folder)


def thin(sample: Path) -> None:
    """Leave nine photographs of a camera of a sample, and a fifth of the frames of a long table."""
    for photograph in sample.glob("**/*.jpg"):
        if int(photograph.stem[-2:]) > 9:
            photograph.unlink()
    for table in sample.glob("*.csv"):
        head, *rows = table.read_text().splitlines(keepends=True)
        if len(rows) > 400 and head.startswith("frame,"):
            table.write_text(head + "".join(r for r in rows if int(r.partition(",")[0]) % 5 == 0))


if __name__ == "__main__":
    for make in (archives, bump, world):
        (SAMPLES / make.__name__).mkdir(exist_ok=True)
        make(SAMPLES / make.__name__)
