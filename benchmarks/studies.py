"""What the benchmarks share: the command line, tables, and real recordings cut in parts."""

import argparse
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta

from stereocal.fit.screening.screen import screen
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.correspondences import TARGETS, Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import RigidObject

Asked = argparse.Namespace
"""What the command line asks for: `trials`, `numbers` (a range) and the options of a benchmark."""
Study = Callable[[Asked], None]
SAMPLES = Path(__file__).parents[1] / "sample_data"
RECORDING = SAMPLES / "recording"


def run_studies(
    studies: Mapping[str, tuple[Study, int]], about: str | None, **options: Any
) -> None:
    """Run the studies named on the command line, or all.

    Args:
        studies: by name, a study and its usual number of trials.
        about: what the studies are.
        options: their usual values; a list takes several, an empty one texts, False is a flag.
    """
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=formatter)
    parser.add_argument("studies", nargs="*", choices=[*studies, []], default=[], metavar="STUDY")
    parser.add_argument("--trials", "--rigs", type=int, help="rigs, or other trials, of each")
    parser.add_argument("--first", "--seed", type=int, default=0, help="number of the first one")
    for name, usual in options.items():
        if usual is False:
            parser.add_argument(f"--{name}", action="store_true")
            continue
        several, kind = isinstance(usual, list), type(np.ravel(usual or "")[0].item())
        parser.add_argument(f"--{name}", type=kind, nargs="+" if several else None, default=usual)
    parsed = parser.parse_args()
    for name in parsed.studies or studies:
        study, usual = studies[name]
        trials, begun = parsed.trials or usual, time.process_time()
        numbers = range(parsed.first, parsed.first + trials)
        print(f"{name}, {trials} trials:", flush=True)
        study(Asked(**{**vars(parsed), "trials": trials, "numbers": numbers}))
        print(f"  {name}: {time.process_time() - begun:.0f} s of CPU time", flush=True)


def exact_interval(found: int, of: int) -> str:
    """A share with its exact 95 % binomial interval, in per cent."""
    low = beta.ppf(0.025, found, of - found + 1) if found else 0.0
    high = beta.ppf(0.975, found + 1, of - found) if found < of else 1.0
    return f"{100 * found / of:.2f} % ({100 * low:.2f} to {100 * high:.2f})"


def spread(values: ArrayLike, middle: float = 90.0) -> str:
    """Median and, in brackets, the middle part of the values, in per cent."""
    percent = (50.0 - middle / 2, 50.0, 50.0 + middle / 2)
    low, median, high = np.percentile(np.asarray(values), percent)
    return f"{median:.3g} ({low:.3g} to {high:.3g})"


def rms(values: ArrayLike) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def real_data() -> Path:
    """The folder of recordings that are not in the repository."""
    return Path(os.environ["STEREOCAL_REAL_DATA"])


def recording_of(name: str) -> Recording:
    """A data set; or some cameras of one with more: FOLDER/ewand123:1-3."""
    path, _, cameras = name.partition(":")
    whole = read_recording(path)
    return whole.of_cameras(cameras.split("-")) if cameras else whole


def pair_of(name: str) -> Pair:
    """A recording of two cameras without the frames that its screening leaves out.

    Raises:
        StereocalError: it has more cameras.
    """
    path, _, cameras = name.partition(":")
    data = pair_to_calibrate(read_recording(path), cameras or None)
    own = data.correspondences.rigid_object
    return screen(data if own is None else _outer_targets(data, own)).dataset


def _outer_targets(data: Pair, own: RigidObject) -> Pair:
    """A and B alone, as in the data set of two cameras: a third marker has errors of its own."""
    rows = data.correspondences
    names = np.array(own.names)[rows.target]
    kept = np.isin(names, TARGETS)
    bars = Correspondences.from_arrays(
        rows.frame[kept], names[kept], rows.primary[kept], rows.secondary[kept]
    )
    a, b = (np.array(own.points[own.names.index(name)]) for name in TARGETS)
    length = float(np.linalg.norm(a - b))
    return data.changed(correspondences=bars, target_distance_m=length)


def parts_in_time(data: Pair, parts: int) -> Iterator[tuple[Pair, Pair]]:
    """Each part in time, and the rest of the frames."""
    frames = data.correspondences.frames
    for own in np.array_split(frames, parts):
        yield data.of_frames(own), data.of_frames(np.setdiff1d(frames, own))
