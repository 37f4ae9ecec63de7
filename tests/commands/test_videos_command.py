"""`detect --videos`: targets in frames of two videos, against the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.formats.correspondences_csv import read_table
from stereocal.system.photograph import read_photograph
from tests.videos import write_video

pytest.importorskip("av")

SAMPLE = Path(__file__).parents[2] / "sample_data" / "photographs"
FRAMES = (1, 2, 3, 4, 5, 6)


def test_targets_in_videos(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "data"
    data.mkdir()
    for name in ("dataset.json", "primary.json", "secondary.json"):
        (data / name).write_bytes((SAMPLE / name).read_bytes())
    paths, times = [], [k / 10 for k in range(len(FRAMES))]
    for which in ("primary", "secondary"):
        images = [read_photograph(SAMPLE / which / f"{frame:04d}.jpg") for frame in FRAMES]
        path = tmp_path / f"{which}.mp4"
        paths.append(write_video(path, times, draw=images.__getitem__, preset="ultrafast"))
    out = tmp_path / "correspondences.csv"
    given = [str(data), "--videos", *map(str, paths), "--every", "1", "--out", str(out)]
    assert main(["detect", *given]) == 0
    assert "6 pairs of frames were taken" in capsys.readouterr().err
    written = sorted(path.name for path in (data / "primary").iterdir())
    assert written == [f"{frame:06d}.png" for frame in FRAMES]
    rows = read_table(out.read_bytes(), "table").correspondences
    truth = json.loads((SAMPLE / "truth.json").read_text())["frames"]
    for row, (frame, target) in enumerate(zip(rows.frame, rows.target, strict=True)):
        true = truth[int(frame) - 1]
        ends = [true[f"pixels_{which}"] for which in ("primary", "secondary")]
        found = np.array([rows.primary[row], rows.secondary[row]])
        # A and B of the detection may be exchanged, alike in both cameras.
        errors = [np.abs(found - [end[name] for end in ends]).max() for name in "AB"]
        assert min(errors) < 0.1, (frame, target)
    assert len(rows.bars) == 6
