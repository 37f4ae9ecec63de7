"""stereocal's four methods, each from the points on, with the settings it has by default."""

from benchmarks.peers.solution import Peer, Solution
from stereocal.calibration import montecarlo
from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.montecarlo import Problem, SearchSettings, minimise
from stereocal.fit.least_squares.unknowns import FIXED_LENS, RefineSettings
from stereocal.fit.refine import refine
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair

HELD = RefineSettings(lenses=dict.fromkeys(CAMERAS, FIXED_LENS))


def essential(dataset: Pair) -> Solution:
    """Method 1."""
    found = calibrate_essential(dataset.rays, dataset.baseline_m)
    return Solution.as_given(found.pose, dataset)


def matching(dataset: Pair) -> Solution:
    """Method 2, the essential method before it included."""
    return _searched(dataset, montecarlo.reprojection_problem(dataset))


def measuring(dataset: Pair) -> Solution:
    """Method 3, likewise."""
    return _searched(dataset, montecarlo.reconstruction_problem(dataset))


def refined(dataset: Pair, settings: RefineSettings | None = None) -> Solution:
    """Method 4; the priors are the defaults: focal 1 %, centre 10 px, baseline 1 %, bar 0.1 %."""
    found = refine(dataset, settings)
    return Solution(found.pose.R, found.pose.T, (found.primary, found.secondary))


def refined_held(dataset: Pair) -> Solution:
    """Method 4 with both lenses held as stated."""
    return refined(dataset, HELD)


def _searched(dataset: Pair, problem: Problem) -> Solution:
    start = calibrate_essential(dataset.rays, dataset.baseline_m).pose
    return Solution.as_given(minimise(problem, start, SearchSettings()).pose, dataset)


BOTH = "bar 0.1 % and baseline 1 %"

PEERS = (
    Peer("stereocal essential", essential, "measured baseline", "held", "trusts all"),
    Peer("stereocal 2D", matching, "measured baseline", "held", "trusts all"),
    Peer(
        "stereocal 3D",
        measuring,
        "measured baseline, angles by bar",
        "held",
        "trusts all, sum of absolute errors",
    ),
    Peer("stereocal refined", refined, BOTH, "f, c freed, priors", "bad frames left out"),
    Peer("stereocal refined, lenses held", refined_held, BOTH, "held", "bad frames left out"),
)
