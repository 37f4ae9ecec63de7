"""What a script gets from `import stereocal`, and that the documented script runs."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stereocal
from stereocal.rig.parameters import RigParameters

ROOT = Path(__file__).parents[1]


def test_the_documented_script_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/library.md").read_text(), re.S)
    lines = [line for line in script.splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 20
    (tmp_path / "field").symlink_to(ROOT / "sample_data" / "field")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(script, "library.md", "exec"), names)
    pairs, points = names["pairs"], names["points"]
    assert len(pairs) == len(points) > 45  # type: ignore[arg-type]  # of 50
    assert np.isfinite(points[["x", "y", "z", "sigma_z"]].to_numpy()).all()  # type: ignore[index]
    assert RigParameters.load("parameters_3d.json").purpose == "reconstruction"
    assert Path("opencv_files/extrinsics.yml").is_file()
    assert "error_px" in capsys.readouterr().out


def test_calibrate_gives_the_refined_set_unless_told_not_to() -> None:
    dataset = stereocal.read_dataset(ROOT / "sample_data" / "field")
    refined = stereocal.calibrate(dataset).parameters("refined")
    assert (refined.method, refined.purpose) == ("refined", "both")
    # The lenses as given are off; the refined set finds them again (sample_data/README.md).
    assert refined.primary.K[0, 0] != dataset.primary.K[0, 0]
    with pytest.raises(stereocal.StereocalError, match="no refined set"):
        stereocal.calibrate(dataset, refined=None).parameters("refined")


def test_every_name_is_there() -> None:
    assert set(stereocal.__all__) <= set(dir(stereocal))
    for name in stereocal.__all__:
        assert getattr(stereocal, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = stereocal.nothing


def test_importing_alone_is_quick() -> None:
    """It brings none of the large packages."""
    large = {"numpy", "numba", "cv2", "scipy"}
    code = f"import stereocal, sys; print(sorted({large} & set(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True
    )
    assert run.stdout.strip() == "[]"
