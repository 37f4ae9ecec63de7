"""Before and after the field day: plan it, find targets, calibrate lenses, check the cameras."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pandas as pd

from stereocal.errors import StereocalError
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import NewImages, images_of_bars, images_of_pairs
from stereocal.field.checking.to_check import CheckAnswer, with_new
from stereocal.field.planning.forecast import PlanForecast, forecast, plan_answer
from stereocal.fit.rig_file import RigFile
from stereocal.fit.timing.started_by_hand import BroughtIntoStep, bring_into_step
from stereocal.formats.dataset_files import read_recording
from stereocal.formats.plan_file import read_plan
from stereocal.frames.video.extract import with_frames
from stereocal.intrinsics.boards import find_boards
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.calibrate_lens import calibrate_lens as lens_from_boards
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.quality import LENS_COLUMNS, advice, lens_answer, lens_rows
from stereocal.library.calibrations import pair_of
from stereocal.library.drawing import draw, of_figures
from stereocal.matching.point_table import PointTable
from stereocal.rig.camera import LensModel
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.simulation.nineteen import simulate_nineteen
from stereocal.system.answers import Answer, TableAnswer, answering
from stereocal.system.arguments import checked
from stereocal.system.executors import engine
from stereocal.system.photograph_files import photographs_of
from stereocal.system.resources import ROOT

if TYPE_CHECKING:
    import plotly.graph_objects as go


@checked
def sample(name: str) -> Path:
    """The folder of sample data, to read and to copy; `stereocal sample --help` lists them."""
    known = {folder.name: folder for folder in (ROOT / "sample_data").iterdir() if folder.is_dir()}
    if name not in known:
        raise StereocalError(f'There is no sample "{name}": there are {", ".join(sorted(known))}.')
    return known[name]


@checked
def simulate(datasets: int = 19, frames: int = 25, seed: int = 0) -> list[Pair]:
    """Simulated data sets as the paper's nineteen, each with another bar and baseline."""
    return [dataset for _, dataset in simulate_nineteen(seed, datasets, frames)]


@dataclass(frozen=True, eq=False, repr=False)
class Plan(TableAnswer, PlanForecast):
    """What a planned field day will measure, and how well."""

    @property
    def answer(self) -> list[str]:
        return [plan_answer(self), *self.advice.sentences]

    def to_dataframe(self) -> pd.DataFrame:
        """The figures of each set."""
        return pd.DataFrame(of_figures("tables.plan_table", self))

    @checked
    def plot(self, look: Literal["depths", "map"] = "depths") -> go.Figure:
        """The length error by depth; or the errors by place, from above and from the side."""
        return draw(f"plan_report.plot_plan_{look}", [self] if look == "depths" else self)


@checked
def plan(
    path: str | Path, rigs: int | None = None, seed: int = 0, lens_model: LensModel | None = None
) -> Plan:
    """The forecast of a `plan.json`.

    Args:
        rigs: drawn from the plan and its uncertainties; None: 128, fewer for many frames.
    """
    with engine() as workers:
        planned = forecast(read_plan(path, lens_model), workers, seed, rigs)
    return answering(Plan, planned)


@dataclass(frozen=True, eq=False, repr=False)
class InStep(BroughtIntoStep):
    """Cameras that were started by hand, in one count of frames: `recording` is to calibrate
    from."""

    @checked
    def plot(self, pair: CameraPair | None = None) -> go.Figure:
        """The distance from the epipolar lines against the offset; of the first pair, or of one."""
        pair = self.recording.pair_named("-".join(pair)) if pair else next(iter(self.pairs))
        return draw("started_by_hand.plot_offsets", self.pairs[pair])


@checked
def sync(recording: str | Path | Recording, lens_model: LensModel | None = None) -> InStep:
    """Bring cameras into step that were started by hand and count their own frames.

    Args:
        recording: as each camera counted; or its folder or zip.

    Raises:
        StereocalError: the data do not tell the offsets, or pairs contradict each other.
    """
    if isinstance(recording, str | Path):
        recording = read_recording(recording, lens_model, as_counted=True)
    in_step = bring_into_step(recording)
    return answering(InStep, in_step)


@dataclass(frozen=True, eq=False, repr=False)
class Lens(TableAnswer, LensCalibration):
    """A lens from photographs of a board; `camera` is for the file."""

    @property
    def answer(self) -> list[str]:
        return [lens_answer(self), *advice(self)]

    def to_dataframe(self) -> pd.DataFrame:
        """The values with their standard errors."""
        return pd.DataFrame(lens_rows(self), columns=LENS_COLUMNS).set_index(LENS_COLUMNS[0])

    @checked
    def plot(self, look: Literal["residuals", "photographs", "draws"] = "residuals") -> go.Figure:
        """Residuals over the image; errors by photograph; or the scatter of the draws."""
        drawn = {"photographs": "plot_view_errors", "draws": "plot_draws"}
        return draw(f"lens.{drawn.get(look, 'plot_residual_field')}", self)


@checked
def calibrate_lens(
    photographs: str | Path | Iterable[str | Path],
    board: str | BoardPattern,
    square_m: float | None = None,
    settings: LensSettings | None = None,
) -> Lens:
    """Calibrate a lens from photographs of a chessboard or ChArUco board, or from a video of it.

    Args:
        photographs: a folder, a zip, or files; one of them may be a video, whose sharpest still
            frames are taken.
        board: its inner corners, such as "18x12", with `square_m`; or a pattern.

    Raises:
        StereocalError: too few boards are found, or they determine no lens.
    """
    if isinstance(board, str):
        board = BoardPattern.parse(board, square_m or 0.0)
    several = [photographs] if isinstance(photographs, str | Path) else list(photographs)
    with tempfile.TemporaryDirectory(prefix="stereocal-") as store, engine() as workers:
        sources = with_frames(map(Path, several), Path(store))
        files = photographs_of(sources, Path(store))
        lens = lens_from_boards(
            find_boards(files, board, workers), settings or LensSettings(), workers
        )
    return answering(Lens, lens)


@dataclass(frozen=True, eq=False, repr=False)
class Check(Answer, CheckAnswer):
    """Whether a camera has moved since the parameters were found; `verdict` is `moved`, `same` or
    `cannot tell`."""

    @property
    def answer(self) -> list[str]:
        return [self.sentence, *(f"Note: {note}" for note in self.notes)]

    @checked
    def plot(self, pair: CameraPair | None = None) -> go.Figure:
        """The residuals by frame, before and after; of the first pair, or of one."""
        return draw("frame_errors.plot_check", self.residuals[pair or next(iter(self.residuals))])


@checked
def check(
    parameters: RigParameters | RigFile,
    new: Pair | Recording | pd.DataFrame,
    turn_deg: float | None = None,
    baseline_change: float | None = None,
    sigma_px: float | None = None,
) -> Check:
    """Check with a few new bars, or with matched points alone, whether a camera has moved.

    Args:
        parameters: with their covariance, as of the refined or the 2D set; or a rig.
        new: a data set; or a table of pairs as `match` returns it.
        turn_deg, baseline_change: the smallest that matter: "same" is said only if they would be
            seen; None: those of the command.
        sigma_px: noise of matched points, if they are less exact than the targets.

    Raises:
        StereocalError: the file has no covariance, or nothing fits the points.
    """

    def images(two: RigParameters) -> NewImages:
        if isinstance(new, pd.DataFrame):
            table = PointTable(pd.DataFrame(new), PIXELS, "the table of pairs")
            return images_of_pairs(table, two).stating(sigma_px)
        return images_of_bars(pair_of(new), two)

    def recording(_rig: RigFile) -> Recording:
        if not isinstance(new, Recording):
            raise StereocalError("A rig is checked with a recording of its cameras.")
        return new

    check = with_new(parameters, images, recording).check(Smallest.of(turn_deg, baseline_change))
    return answering(Check, check)
