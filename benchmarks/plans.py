"""Whether the forecast of a plan comes true: rigs drawn from plans, and a real recording.

    python -m benchmarks.plans [simulated|real] [--rigs 20] [--focal 0.01] [--centre 10]

- simulated: for every plan, rigs whose truth is drawn from it, each with an independently simulated
  recording that is calibrated as `calibrate` does, and judged on 1000 fresh bars of true length:
  the forecast over the mean of what was observed, and the share of the single rigs within the
  interval of the forecast;
- real: a plan with the cameras, pose, depths, bar, noise and number of frames of a part of
  `sample_data/recording`, against the length error of the rest; even frames fitted and odd ones
  held out, and the reverse. The held-out bars are the same bar, whose own error does not show, so
  it counts as exact.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np

from benchmarks.studies import RECORDING, Asked, run_studies
from stereocal.calibration.methods import FILE_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import count_set
from stereocal.field.planning.forecast import PlanForecast, forecast
from stereocal.field.planning.plan import AimedPose, Plan, SensorLens, Uncertainty
from stereocal.fit.least_squares.unknowns import DEFAULT_CENTRE_PX, DEFAULT_FOCAL, RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.screening.screen import screen
from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.simulation.simulate import field_rig
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.fresh_frames import draw_noise
from tests.rigs import known_rig
from tests.rigs.population import observed

DRAWS = 400
EXACT = Uncertainty(0.0005, 0.5, 0.002, 0.0002)
FIELD = field_rig()
WEBCAM = SensorLens(4.0, (5.376, 3.024), (1920, 1080))
OUTDOORS = SensorLens(35.0, (23.5, 15.6), (6000, 4000))
FIELD_DAY = Plan("field day of the paper", FIELD.primary, FIELD.secondary, FIELD.pose, 8, 25, 0.9)
PLANS = (
    FIELD_DAY,
    replace(FIELD_DAY, name="the same, lenses well known", uncertainty=EXACT),
    Plan(
        "unlike cameras with distortion",
        known_rig.PRIMARY,
        known_rig.SECONDARY,
        Pose.from_angles(Angles(0.24, -0.07, 0.11, 0.13, 3.02), 2.37),
        4,
        10,
        0.87,
        50,
        0.3,
    ),
    Plan(
        "two webcams over a tank",
        WEBCAM,
        WEBCAM,
        AimedPose(0.5, 14.0),
        0.6,
        1.5,
        0.2,
        25,
        0.15,
        Uncertainty(0.004, 6.0, 0.002, 0.0002),
    ),
    Plan(
        "birds far away",
        OUTDOORS,
        OUTDOORS,
        AimedPose(8.0, 5.0, 0.5),
        30,
        70,
        2.0,
        40,
        0.25,
        Uncertainty(0.002, 8.0, 0.02, 0.002),
    ),
)


def compare(found: PlanForecast, rigs: dict[tuple[Method, str], list[float]]) -> None:
    """A line for each file and figure."""
    for (method, name), values in rigs.items():
        said, true = found.estimate(method, name), np.array(values)
        held = np.mean((said.low <= true) & (true <= said.high))
        spread = true.std() / np.sqrt(len(true)) / true.mean()
        print(
            f"  {method:8s} {name:22s} forecast {said.value:.5f}, observed {true.mean():.5f}: "
            f"ratio {said.value / true.mean():.2f} (± {2 * spread:.2f}), {100 * held:.0f} % within"
        )


def simulated(asked: Asked) -> None:
    """Rigs drawn from each plan."""
    for plan in PLANS:
        found = forecast(plan)
        print(f"  {plan.name}: limited by {found.advice.limited_by}")
        each: dict[tuple[Method, str], list[float]] = defaultdict(list)
        for seed in asked.numbers:
            try:
                for key, value in observed(plan, seed).items():
                    each[key].append(value)
            except StereocalError as error:
                print(f"  rig {seed}: {error}")
        compare(found, each)


def plan_of(fitted: Pair, uncertainty: Uncertainty) -> Plan:
    """The plan that this recording carried out: all but its points.

    The noise is that of the model of the noise, without the tails that `sigma_px` contains: the
    root mean square of the one combination of the four coordinates of a pair that its distance from
    the epipolar line shows, and the three that the lengths show.
    """
    found = refine(fitted, RefineSettings())
    draws = draw_noise(found, DRAWS, np.random.default_rng(0))
    along = draws.along * draws.across
    noise = found.sigma_px.value * np.sqrt(np.median((draws.across**2 + 3 * along**2) / 4))
    depths = found.points_m[~found.outlying][..., 2]
    return Plan(
        fitted.name,
        fitted.primary,
        fitted.secondary,
        found.pose,
        float(np.nanmin(depths)),
        float(np.nanmax(depths)),
        fitted.target_distance_m,
        int((~found.outlying).sum()),
        float(noise),
        uncertainty,
    )


def real(asked: Asked) -> None:
    """Even frames fitted and odd ones held out, and the reverse."""
    uncertainty = Uncertainty(asked.focal, asked.centre, 0.005, 0.0)
    data = read_dataset(RECORDING)
    left_out, numbers = screen(data).left_out, data.correspondences.frames
    for parity in (0, 1):
        fitted = data.of_frames(numbers[numbers % 2 == parity])
        rest = numbers[numbers % 2 != parity]
        sound = data.of_frames(rest[~np.isin(rest, left_out)])
        found = forecast(plan_of(fitted, uncertainty))
        files = forecast_files(calibrate(fitted)).files
        for method in FILE_METHODS:
            rig = files[method]
            seen = sound.changed(primary=rig.primary, secondary=rig.secondary)
            true = float(np.nanmean(np.abs(count_set(seen, rig.pose).lengths[0] - 1.0)))
            said = found.estimate(method, "mean_length_error")
            print(
                f"  {'even' if parity == 0 else 'odd'} {method:8s} forecast {said.value:.5f} "
                f"({said.low:.5f} to {said.high:.5f}), held out {true:.5f}: ratio "
                f"{said.value / true:.2f}"
            )


if __name__ == "__main__":
    options = {"focal": DEFAULT_FOCAL, "centre": DEFAULT_CENTRE_PX}
    run_studies({"simulated": (simulated, 20), "real": (real, 1)}, __doc__, **options)
