"""Calls of the library with something else than is meant: an error that says what is."""

import inspect
import re
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import stereocal
from stereocal.library.calibrations import CalibrationRun
from stereocal.system.answers import answering
from stereocal.system.arguments import INSTEAD, WAYS
from tests.refused import refused
from tests.sample_field import FIELD, calibrated_field

library: Any = stereocal
"""Called wrongly on purpose, which type checkers see."""


class Given:
    """What a script has at hand."""

    def __init__(self) -> None:
        self.path = str(FIELD)
        self.run: Any = answering(CalibrationRun, calibrated_field())
        self.recording: Any = self.run.dataset
        self.table = self.recording.to_dataframe()
        self.points = self.table[["frame"]].assign(u=1.0, v=1.0)
        self.array = np.zeros((3, 4))
        self.camera = self.recording.primary
        self.cameras = {"primary": self.camera, "secondary": self.camera}
        self.two_d = self.run.sets["2d"]


@pytest.fixture(scope="module")
def given() -> Given:
    return Given()


READ, SET, TABLE = "stereocal.read(path)", 'run.sets["2d"]', "read_csv(path)"
PATH = "path must be str | Path"
CALLS: list[tuple[Callable[[Given], object], str]] = [
    (lambda it: library.read(it.recording), PATH),
    (lambda it: library.read(it.table), PATH),
    (lambda it: library.read([it.path]), PATH),
    (lambda it: library.read(it.path, None, it.path), "'brown' | 'fisheye'"),
    (lambda it: library.read_dataset(it.table), PATH),
    (lambda it: library.read_camera(it.camera), "Path, not Camera"),
    (lambda it: library.calibrate(it.path), READ),
    (lambda it: library.calibrate(Path(it.path)), READ),
    (lambda it: library.calibrate(it.table), READ),
    (lambda it: library.calibrate(it.array), READ),
    (lambda _: library.calibrate(None), READ),
    (lambda it: library.calibrate(it.run), "run.dataset"),
    (lambda it: library.calibrate(it.recording, it.path), "CalibrationSettings()"),
    (lambda it: library.calibrate(it.recording, seed=1), "'seed'; it takes dataset, settings"),
    (lambda _: library.calibrate(), "'dataset'"),
    (lambda it: library.evaluate(it.path), READ),
    (lambda it: library.evaluate(it.recording), "into a list"),
    (lambda it: library.evaluate([it.path]), READ),
    (lambda it: library.evaluate(it.table), READ),
    (lambda _: library.evaluate([]), "no recording"),
    (lambda it: library.evaluate([it.recording], runs=2.5), "int, not 2.5"),
    (lambda it: library.calibrate_rig(it.path), READ),
    (lambda it: library.calibrate_rig(it.recording), "pair.recording"),
    (lambda it: library.match(it.path, it.table, it.table), SET),
    (lambda it: library.match(it.run, it.table, it.table), SET),
    (lambda it: library.match("2d", it.table, it.table), SET),
    (lambda it: library.match(it.two_d, it.path, it.path), TABLE),
    (lambda it: library.match(it.two_d, {"primary": it.path}), TABLE),
    (lambda it: library.match(it.two_d, it.array, it.array), TABLE),
    (lambda it: library.match(it.two_d, {}), "no points"),
    (lambda it: library.match(it.two_d, it.points), "primary, secondary"),
    (lambda it: library.match(it.two_d, it.table, it.table, depths_m=(3.0,)), "depths_m"),
    (lambda it: it.run.sets["4d"], "2d, 3d, refined"),
    (lambda it: library.reconstruct(it.path, it.table), SET),
    (lambda it: library.reconstruct(it.two_d, it.path), TABLE),
    (lambda it: library.reconstruct(it.table, it.two_d), SET),
    (lambda it: library.reconstruct(it.two_d, it.table, it.array), "stereocal.Pose"),
    (lambda it: library.plan(it.recording), PATH),
    (lambda _: library.sample(5), "must be str"),
    (lambda _: library.sample("../docs"), "recording, rig"),
    (lambda _: library.simulate("three"), "int, not 'three'"),
    (lambda _: library.simulate(1, 25, -1), "seed"),
    (lambda it: library.detect(it.recording), PATH),
    (lambda it: library.detect(it.path, library.BoardPattern(9, 6, 0.03)), "target must be str"),
    (lambda it: library.sync(it.recording), "pair.recording"),
    (lambda it: library.sync(it.table), READ),
    (lambda it: library.calibrate_lens(it.recording, "18x12", 0.03), "photographs must be"),
    (lambda it: library.calibrate_lens(it.path, (18, 12), 0.03), "BoardPattern"),
    (lambda it: library.check(it.path, it.recording), SET),
    (lambda it: library.check(it.run, it.recording), SET),
    (lambda it: library.check(it.two_d, it.path), READ),
    (lambda it: library.check(it.two_d, it.recording, turn_deg=-1.0), "above 0"),
    (lambda it: library.export(it.run, "opencv", "out"), SET),
    (lambda it: library.export(it.two_d, "opencv", None), PATH),
    (lambda it: library.import_parameters([it.path], "opencv"), PATH),
    (lambda it: library.RigParameters.load(it.recording), PATH),
    (lambda _: library.BoardPattern.parse((9, 6), 0.03), "size must"),
    (lambda it: library.Recording.from_dataframe(it.path, it.cameras, 0.9, 4.5), TABLE),
    (
        lambda it: library.Recording.from_dataframe(it.table, {"primary": it.path}, 0.9),
        "read_camera",
    ),
    (
        lambda it: library.Recording.from_arrays(
            [1], ["primary"], ["A"], [[1.0, 2.0]], {"primary": it.camera}, 0.9
        ),
        "two cameras",
    ),
    (
        lambda it: library.Recording.from_arrays(
            [1], ["primary"], ["A"], [[1.0, 2.0, 3.0]], it.cameras, 0.9
        ),
        "(n, 2)",
    ),
    (lambda it: it.recording.recording.pair("left-right"), "'second'"),
    (lambda it: it.recording.recording.pair("left", "right"), "primary, secondary"),
    (lambda _: library.Camera(np.eye(3), np.zeros(5), 100), "(w, h)"),
    (lambda it: it.run.evaluate(runs="100"), "runs must be int"),
    (lambda it: it.run.save(None), "folder must be"),
    (lambda it: it.run.export("opencv", "out", "4d"), "'3d'"),
    (lambda it: it.run.plot("photographs"), "'residuals'"),
    (lambda it: it.run.plot("rig", "4d"), "'3d'"),
]


@pytest.mark.parametrize("number", range(len(CALLS)))
def test_a_wrong_call_says_what_is_meant(given: Given, number: int) -> None:
    call, meant = CALLS[number]
    with refused(meant):
        call(given)


def test_every_function_is_checked_and_every_way_exists() -> None:
    functions = {
        name: getattr(stereocal, name)
        for name in stereocal.__all__
        if inspect.isfunction(getattr(stereocal, name))
    }
    assert len(functions) > 12
    assert [name for name, own in functions.items() if not hasattr(own, "__wrapped__")] == []
    known: dict[str, Any] = {"stereocal": stereocal, "pandas": pd, "run": CalibrationRun}
    known |= {name: getattr(stereocal, name) for name in stereocal.__all__}
    for way in [*WAYS.values(), *INSTEAD.values()]:
        for owner, name in re.findall(r"\b([a-zA-Z]+)\.(\w+)", way):
            if owner in known:
                of = known[owner]
                assert hasattr(of, name) or name in of.__dataclass_fields__, way


def test_what_fits_is_passed_on() -> None:
    """NumPy's numbers, an iterator, which a look would use up, and any kind of sequence."""
    two = library.simulate(np.int64(2), 25)
    of_both = dict(enumerate(two)).values()
    for recordings in (iter(two), tuple(two), of_both):
        found = library.evaluate(recordings, runs=1)
        assert len(found.evaluation.names) == 2
    assert isinstance(stereocal.simulate, types.FunctionType)
    assert "datasets" in inspect.signature(stereocal.simulate).parameters
