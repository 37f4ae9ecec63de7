"""From files on disk to frames with targets, against the truth of rendered photographs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.cli import main
from stereocal.detection.detect import Detection, detect_targets
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.frames.frame import Frame
from stereocal.frames.pairing import pair_names
from stereocal.frames.search import compile_detection, detect_frames
from tests.bar_photographs import bar_set, write

BARS = bar_set(7)
CAMERAS = (BARS.rig.primary, BARS.rig.secondary)
FILES = BARS.files()


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(2) as executor:
        yield executor


def detect(
    files: dict[str, bytes],
    folder: Path,
    pool: ThreadPoolExecutor,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Frame] | None:
    write(files, folder)
    photographs = {name: folder / name for name in files}
    pairs = pair_names(FILES).pairs
    return detect_frames(
        pairs, photographs, CAMERAS, pool, lambda _: None, lambda *_: None, cancelled
    )


def png(image: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", image)[1])


def away(frame: Frame, camera: int, truth: np.ndarray, swap: bool) -> float:
    found = np.array([(c.u, c.v) for c in frame.centres[camera] if c])
    return float(np.linalg.norm(found - (truth[::-1] if swap else truth), axis=1).max())


def test_found_where_they_are_and_labelled_alike(tmp_path: Path, pool: ThreadPoolExecutor) -> None:
    frames = detect(FILES, tmp_path, pool)
    assert frames is not None
    for frame, pair in zip(frames, BARS.pairs, strict=True):
        assert (frame.frame, frame.state, frame.use) == (pair.frame, "found", True)
        # A and B may be exchanged, but in both cameras. Measured: 0.012 px at most.
        truth = pair.centres_primary, pair.centres_secondary
        errors = [[away(frame, k, truth[k], swap) for k in (0, 1)] for swap in (False, True)]
        assert min(map(max, errors)) < 0.05


def test_what_is_bad_refuses_its_own_frame(tmp_path: Path, pool: ThreadPoolExecutor) -> None:
    height, width = BARS.pairs[0].primary.shape
    hidden = BARS.pairs[6].secondary.copy()
    u, v = BARS.pairs[6].centres_secondary[0].astype(int)
    hidden[max(v - 45, 0) : v + 45, max(u - 45, 0) : u + 45] = 110
    bad = FILES | {
        "primary/left1.png": png(np.zeros((height, width), np.uint8)),
        "secondary/right2.png": png(np.full((height, width), 255, np.uint8)),
        "primary/left3.png": b"a text",
        "secondary/right4.png": FILES["secondary/right4.png"][:-100],
        "primary/left5.png": png(np.zeros((height // 2, width), np.uint8)),
        "secondary/right7.png": png(hidden),
    }
    del bad["primary/left6.png"]
    frames = detect(bad, tmp_path, pool)
    assert frames is not None
    assert [frame.state for frame in frames] == ["refused"] * 7
    assert not any(frame.use for frame in frames)
    reasons = [frame.reason for frame in frames]
    assert reasons[0].startswith("Primary: ") and reasons[1].startswith("Secondary: ")
    assert "left3.png: " in reasons[2]
    assert "right4.png: the PNG is cut off" in reasons[3]
    assert "left5.png: it has 584x216 px, and the primary camera's file says 584x432" in reasons[4]
    assert "left6.png: there is no such photograph" in reasons[5]
    assert reasons[6].startswith("Secondary: ")
    # What the other photograph shows is kept for a person to go on with.
    assert frames[6].centres[0][0] is not None and frames[6].centres[1] == (None, None)


def test_cancelled(tmp_path: Path, pool: ThreadPoolExecutor) -> None:
    asked = threading.Event()

    def cancelled() -> bool:
        asked.set()
        return True

    assert detect(FILES, tmp_path, pool, cancelled) is None
    assert asked.is_set()


def test_a_compiled_search_finds_the_drawn_boards() -> None:
    seen: list[Detection] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "stereocal.frames.search.detect_targets", lambda i: seen.append(detect_targets(i))
        )
        compile_detection()
    # Only a photograph with targets runs all that is to be compiled.
    assert seen[0].targets is not None


def test_photographs_to_parameters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    survey, out = tmp_path / "survey", str(tmp_path / "out")
    write(FILES, survey)
    for name, camera in zip(("primary", "secondary"), CAMERAS, strict=True):
        (survey / f"{name}.json").write_bytes(write_camera(camera))
    (survey / "dataset.json").write_text(
        '{"format": "stereocal-dataset/1", "baseline_m": 2, "target_distance_m": 0.9, '
        '"cameras": {"primary": "primary.json", "secondary": "secondary.json"}}'
    )
    assert main(["calibrate", str(survey), "--out", out]) == 2
    said = capsys.readouterr().err
    assert "photographs and no correspondences.csv yet; find the targets" in said
    assert main(["detect", str(survey), "--out", str(survey / "correspondences.csv")]) == 0
    said = capsys.readouterr().err
    assert "14 photographs. 7 pairs by name" in said
    assert "frame 7: found, sigma at most 0.0" in said
    assert "7 frames: 7 found, 0 doubtful, 0 refused" in said
    rows = read_table((survey / "correspondences.csv").read_bytes(), "t").strict("t")
    assert len(rows) == 14 and rows.has_sigmas and (rows.source == 0).all()
    assert main(["calibrate", str(survey), "--out", out]) == 0
