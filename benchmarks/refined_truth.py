"""Is what the refined method says true? Simulated studies with known truth.

    python -m benchmarks.refined_truth [coverage|bound|named|outliers|lenses] [--rigs N]

- coverage: how often the 68 % intervals hold the truth;
- bound: errors over the Cramer-Rao bound;
- named: how often a wrong input is named, and a sound one accused;
- outliers: 10 % gross errors against clean data;
- lenses: lenses off by 0.3 % and 5 px, against the paper's two sets.
"""

from dataclasses import replace

import numpy as np

from benchmarks.studies import Asked, run_studies
from stereocal.fit.least_squares.unknowns import RefineSettings
from tests.rigs.accuracy import (
    NAMES,
    accusations,
    against_the_paper,
    deviations,
    over_bound,
    with_gross_errors,
)
from tests.rigs.refined_rigs import Misjudged, fixed_lenses


def print_coverage(asked: Asked) -> None:
    """Coverage with stated uncertainties, with the defaults, and with exact lenses."""
    known = Misjudged()
    exact = replace(known, focal=0.0, centre_px=0.0)
    default = Misjudged(baseline_m=0.023, bar_m=0.00087, focal=0.01, centre_px=10.0)
    print(f"  68 % intervals that hold the truth; {', '.join(NAMES)}:")
    for name, off, settings in (
        ("stated uncertainties", known, known.settings()),
        ("the same, 0.05 px", replace(known, noise_px=0.05), known.settings()),
        ("the same, 1 px", replace(known, noise_px=1.0), known.settings()),
        ("lenses exact and held", exact, fixed_lenses(exact.settings())),
        ("default priors", default, RefineSettings()),
    ):
        z = deviations(asked.trials, off, settings, seed=6)
        shares = " ".join(f"{100 * share:.1f}" for share in (np.abs(z) <= 1).mean(axis=0))
        print(f"  {name}: {shares}", flush=True)


def print_bound(asked: Asked) -> None:
    """Errors over the Cramer-Rao bound."""
    known = Misjudged()
    exact = replace(known, focal=0.0, centre_px=0.0)
    for name, off, settings in (
        ("exact lenses, held", exact, fixed_lenses(exact.settings())),
        ("lenses drawn from their priors, freed", known, known.settings()),
    ):
        rotation, length = over_bound(asked.trials, off, settings, seed=1)
        print(f"{name}: rotation {rotation:.3f}, length {length:.3f} of the bound", flush=True)


def print_named(asked: Asked) -> None:
    """Wrong inputs named, sound ones accused."""
    for wrong in ("", "baseline", "primary focal"):
        named, accused = accusations(asked.trials, wrong, seed=2)
        what = f"{wrong} wrong: named {named}, others" if wrong else "healthy rigs:"
        print(f"{what} accused {accused}", flush=True)


def print_outliers(asked: Asked) -> None:
    """Spoiled against clean data."""
    for share in (0.1, 0.3):
        rms, (bad, named, false) = with_gross_errors(asked.trials, share, seed=3)
        print(
            f"{share:.0%} gross errors: rotation {rms[2] / rms[0]:.2f}, length "
            f"{rms[3] / rms[1]:.2f} times the clean; named {named:.0f} of {bad:.0f}, false "
            f"{false:.0f} of {30 * asked.trials - bad:.0f}",
            flush=True,
        )


def print_lenses(asked: Asked) -> None:
    """Against the paper's two sets."""
    for noise_px in (0.15, 0.05):
        rows = against_the_paper(asked.trials, noise_px, seed=4)
        length_2d, length, px_3d, px = rows.mean(axis=0)
        print(
            f"noise {noise_px} px: length error {100 * length_2d:.2f} % (2D), {100 * length:.3f} % "
            f"(refined): {length_2d / length:.1f} times; reprojection {px_3d:.1f} px (3D), "
            f"{px:.3f} px (refined): {px_3d / px:.0f} times",
            flush=True,
        )


STUDIES = {
    "coverage": (print_coverage, 1000),
    "bound": (print_bound, 400),
    "named": (print_named, 300),
    "outliers": (print_outliers, 100),
    "lenses": (print_lenses, 50),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
