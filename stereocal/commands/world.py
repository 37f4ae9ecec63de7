"""`stereocal world`: where up is, from surveyed points, lines or a throw."""

import argparse

from stereocal.commands.console import ONE_OF, Number, Options, report
from stereocal.commands.options import contents
from stereocal.field.world.find import find_world
from stereocal.field.world.frame import Axes, WorldSettings
from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.formats.world_file import pair_in_table, read_observed, write_world
from stereocal.rig.parameters import RigParameters
from stereocal.system.atomic_files import write_atomically
from stereocal.system.numbers import POSSIBLE_M

OPTIONS: Options = {
    "observed SURVEY.csv|PLUMB.csv|THROW.csv": "surveyed points (point,x,y,z and pixels of both "
    "cameras), plumb lines, level lines and horizons (line,kind and pixels), or a throw (frame "
    "and pixels)",
    ONE_OF: {
        "--parameters FILE": "the parameters to measure with: parameters_3d.json or "
        "parameters_refined.json",
        "--rig FILE": "rig.json: the table has the pixels of two of its cameras, as u_left,v_left",
    },
    "--out OUT": "world.json",
    "--frame-rate FPS": "frames per second, for a throw",
    "--origin NAME": "camera (the primary), first (first point of a throw) or the name of a "
    "surveyed point (default: the survey's own origin, else camera)",
    "--x-axis NAME": "horizontal part of: view (the primary's viewing direction), baseline, or a "
    "level line's name (default: the survey's own axes, else view)",
    "--heading DEG": "turn the x axis from there, counter-clockwise seen from above (default: 0)",
    "--sigma-px PX": "noise of a pixel coordinate (default: of the residuals of lines or a throw, "
    "else of the parameter file)",
    "--survey-sigma M": {
        "type": Number(float, 0.0, POSSIBLE_M[1]),
        "help": "standard error of a surveyed coordinate in metres (default: %(default)g)",
    },
    "--no-drag": "ignore air drag (for a heavy thrown object)",
    "--upside-down": "the cameras hang upside down (for lines)",
}
DEFAULTS = {"heading": 0.0, "survey_sigma": WorldSettings.survey_sigma_m}


def run(parsed: argparse.Namespace) -> None:
    (content,) = contents([parsed.observed]).values()
    source, rate = str(parsed.observed), parsed.frame_rate
    axes = Axes(parsed.origin, parsed.x_axis, parsed.heading)
    settings = WorldSettings(
        axes, parsed.sigma_px, parsed.survey_sigma, parsed.drag, parsed.upside_down
    )
    rig: Parameters
    if parsed.rig is not None:
        rig = RigFile.load(parsed.rig)
    else:
        rig = RigParameters.load(parsed.parameters)
    cameras = pair_in_table(rig, content, source)
    observed = read_observed(content, source, rate, cameras)
    world = find_world(rig, observed, settings, cameras)
    residuals = [
        f"  {name}: residual x {x:+.4f}, y {y:+.4f}, z {z:+.4f} m"
        for name, (x, y, z) in world.about.get("residuals_m", {}).items()
    ]
    write_atomically(parsed.out, write_world(world, rig))
    report(world.sentence, *residuals, notes=world.notes, written=[parsed.out])
