"""From files on disk to frames with targets, against the truth of rendered photographs."""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.detection.detect import Detection, detect_targets
from stereocal.detection.target import BAR, Target
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table
from stereocal.frames.frame import Frame
from stereocal.frames.pairing import pair_names
from stereocal.frames.search import compile_detection, detect_frames
from stereocal.rig.camera import Camera
from stereocal.system.tasks import Progress, StoppedError
from tests.files import description, encoded, write
from tests.photographs.bars import bar_set

BARS = bar_set(7)
BOTH = "primary", "secondary"
CAMERAS = (BARS.rig.primary, BARS.rig.secondary)
FILES = BARS.files()


def detect(
    files: dict[str, bytes],
    folder: Path,
    cameras: tuple[Camera, Camera] = CAMERAS,
    target: Target = BAR,
    progress: Progress = lambda *_: None,
    names: Iterable[str] = FILES,
) -> list[Frame]:
    """The frames of photographs, which are looked for by their names."""
    write(files, folder)
    photographs = {name: folder / name for name in files}
    with ThreadPoolExecutor(2) as pool:
        lenses = dict(zip(BOTH, cameras, strict=True))
        about = pair_names(names), photographs, lenses, target
        return detect_frames(*about, pool, lambda _: None, progress).frames


def away(frame: Frame, camera: int, truth: np.ndarray, swap: bool) -> float:
    found = np.array([(c.u, c.v) for c in frame.centres[camera] if c])
    return float(np.linalg.norm(found - (truth[::-1] if swap else truth), axis=1).max())


def test_found_where_they_are_and_labelled_alike(tmp_path: Path) -> None:
    frames = detect(FILES, tmp_path)
    for frame, pair in zip(frames, BARS.pairs, strict=True):
        assert (frame.frame, frame.state, frame.use) == (pair.frame, "found", True)
        # A and B may be exchanged, but in both cameras. Measured: 0.012 px at most.
        truth = pair.centres_primary, pair.centres_secondary
        errors = [[away(frame, k, truth[k], swap) for k in (0, 1)] for swap in (False, True)]
        assert min(map(max, errors)) < 0.05


def test_what_is_bad_refuses_its_own_frame(tmp_path: Path) -> None:
    height, width = BARS.pairs[0].primary.shape
    hidden = BARS.pairs[6].secondary.copy()
    u, v = BARS.pairs[6].centres_secondary[0].astype(int)
    hidden[max(v - 45, 0) : v + 45, max(u - 45, 0) : u + 45] = 110
    bad = FILES | {
        "primary/left1.png": encoded(np.zeros((height, width), np.uint8)),
        "secondary/right2.png": encoded(np.full((height, width), 255, np.uint8)),
        "primary/left3.png": b"a text",
        "secondary/right4.png": FILES["secondary/right4.png"][:-100],
        "primary/left5.png": encoded(np.zeros((height // 2, width), np.uint8)),
        "secondary/right7.png": encoded(hidden),
    }
    del bad["primary/left6.png"]
    frames = detect(bad, tmp_path)
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


def test_cancelled(tmp_path: Path) -> None:
    def cancel(_done: int, _total: int) -> None:
        raise StoppedError

    with pytest.raises(StoppedError):
        detect(FILES, tmp_path, progress=cancel)


def test_a_compiled_search_finds_the_drawn_boards() -> None:
    seen: list[Detection] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "stereocal.frames.search.detect_targets", lambda i: seen.append(detect_targets(i))
        )
        compile_detection()
    # Only a photograph with targets runs all that is to be compiled.
    assert seen[0].targets is not None


def test_the_command_writes_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = dict(zip(("primary.json", "secondary.json"), map(write_camera, CAMERAS), strict=True))
    write(FILES | files | {"dataset.json": description("bar", 2.0, 0.9)}, tmp_path)
    out = tmp_path / "correspondences.csv"
    assert main(["detect", str(tmp_path), "--out", str(out)]) == 0
    said = capsys.readouterr().err
    assert "14 photographs. 7 pairs by name" in said
    assert "frame 7: found, sigma at most 0.0" in said
    assert "7 frames: 7 found, 0 doubtful, 0 refused" in said
    rows = read_table(out.read_bytes(), "t").strict("t")
    assert len(rows) == 14 and rows.has_sigmas and (rows.source == 0).all()
    out.unlink()
    assert main(["detect", str(tmp_path), "--target", "tag:3", "--out", str(out)]) == 2
    assert "tags:4X4_50:3,7" in capsys.readouterr().err and not out.exists()
