"""The report of a rig: one HTML file that holds everything and opens without a network."""

from __future__ import annotations

from html import escape

import numpy as np
import pandas as pd

from stereocal.figures.html import html_page, html_plot, html_section, html_table, paragraphs
from stereocal.figures.rig_graph import describe_rig_graph, plot_cameras, plot_rig_graph
from stereocal.network.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.network.rig_file import RigFile
from stereocal.system.numbers import rounded
from stereocal.version import __version__


def rig_report(rig: RigFile, name: str) -> str:
    """The text of the file."""
    title, notes = f"The rig of {name}", rig_notes(rig)
    words = describe_rig_graph(rig)
    listed = "".join(f"<li>{escape(note)}</li>" for note in notes)
    sections = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="answer">{escape(rig_sentence(rig))}</p>',
        html_section("The pairs", html_plot(plot_rig_graph(rig), words, "plot")),
        paragraphs(*filter(None, [loops_sentence(rig)])),
        html_section("The cameras", html_plot(plot_cameras(rig), words, "plot")),
        html_table(camera_table(rig)),
        html_section("What to know", f"<ul>{listed}</ul>") if notes else "",
        html_section("How it was computed", paragraphs(f"stereocal {__version__}. {HOW}")),
    ]
    return html_page(title, sections)


HOW = (
    "Each pair was calibrated by itself; the pairs were fused by what their images tell; a robust "
    "adjustment of all images together left out what contradicts the others; a weighted least "
    "squares of pixels, known lengths and stated lenses gave poses, lenses and their covariance. "
    "Frames that follow each other count for less, by as much as their errors are alike."
)


def camera_table(rig: RigFile) -> pd.DataFrame:
    """Poses and standard errors, a camera a row."""
    rows = []
    content = rig.to_json()["cameras"]
    for name, pose in rig.poses.items():
        own = content[name]["standard_errors"]
        turn = np.degrees([own["turn_x"], own["turn_y"], own["turn_z"]])
        shift = 1000 * np.array([own["x"], own["y"], own["z"]])
        centre = ", ".join(f"{value:.3f}" for value in pose.inverse().T)
        rows.append(
            {
                "camera": name,
                "position, m": centre,
                "rotation ±, °": ", ".join(rounded(value) for value in turn),
                "position ±, mm": ", ".join(rounded(value) for value in shift),
                "focal length, px": f"{rig.cameras[name].K[0, 0]:.1f} ± {rounded(own['fx'])}",
                "image error, px": _image_error(rig, name),
            }
        )
    return pd.DataFrame(rows).set_index("camera")


def _image_error(rig: RigFile, name: str) -> str:
    found = rig.about.get("image_errors_px", {}).get(name)
    return "unknown" if found is None else rounded(found)
