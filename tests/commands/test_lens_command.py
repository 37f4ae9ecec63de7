"""`stereocal intrinsics`, and the camera files that it writes."""

from __future__ import annotations

import io
import json
import re
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.cli import main
from stereocal.formats.camera_file import read_camera, write_camera, write_opencv_camera
from stereocal.rig.camera import Camera, LensUncertainty
from tests import known_rig as rig
from tests.lens import TRUE, write_boards

KNOWN = Camera(
    rig.PRIMARY.K,
    rig.PRIMARY.distortion,
    rig.PRIMARY.image_size,
    LensUncertainty(0.5, 0.6, 0.7, 0.8, np.array([1e-3, 2e-3, 3e-5, 4e-5, 5e-3])),
)
FEW = ["--subset", "8", "--repeats", "10"]


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boards")
    write_boards(folder, 12, seed=5)
    return folder


def run(*arguments: str | Path) -> int:
    return main(["intrinsics", *map(str, arguments), "--board", "8x6", "--square", "0.03", *FEW])


@pytest.fixture(scope="module")
def camera(boards: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file that is written of them."""
    out = tmp_path_factory.mktemp("camera") / "camera.json"
    told = io.StringIO()
    with redirect_stdout(told), redirect_stderr(told):
        assert run(boards, "--out", out) == 0
    said = told.getvalue()
    assert "The focal length fx is 90" in said and "10 draws of 8 out of 12" in said
    assert re.search(r"cx \(px\) +32\d\.\d", said)
    assert "12/12 photographs searched" in said and "10/10 draws calibrated" in said
    return out.read_bytes()


def test_photographs_in_and_the_true_lens_out(camera: bytes) -> None:
    found_camera = read_camera(camera, "camera.json")
    assert found_camera.uncertainty is not None
    K = found_camera.K
    found = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *found_camera.distortion])
    sigma = np.array(
        [
            *(getattr(found_camera.uncertainty, n) for n in ("fx", "fy", "cx", "cy")),
            *found_camera.uncertainty.distortion,
        ]
    )
    # Photographs of 640x480 px, found, refined and calibrated. Measured: 0.2 to 2.2 sigma.
    assert (np.abs(found - TRUE) < 5 * sigma).all()
    assert np.abs(found - TRUE)[:2].max() < 1.0
    about = json.loads(camera)["about"]
    assert about["settings"]["subset"] == 8 and about["board"]["columns"] == 8


class TestCameraFile:
    def test_uncertainty_there_and_back(self) -> None:
        back = read_camera(write_camera(KNOWN, {"method": "test"}), "x.json")
        assert back.uncertainty is not None and KNOWN.uncertainty is not None
        assert back.uncertainty.to_json() == KNOWN.uncertainty.to_json()

    def test_opencv_reads_what_is_written_for_it(self, tmp_path: Path) -> None:
        path = tmp_path / "camera.yml"
        path.write_bytes(write_opencv_camera(KNOWN))
        assert path.read_bytes().startswith(b"%YAML:1.0")
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), KNOWN.K)
        np.testing.assert_array_equal(
            np.ravel(storage.getNode("distortion_coefficients").mat()), KNOWN.distortion
        )
        storage.release()
        back = read_camera(path.read_bytes(), "camera.yml")
        np.testing.assert_array_equal(back.K, KNOWN.K)
        assert back.image_size == KNOWN.image_size
