"""A rig in figures, its cameras from above with a line for each pair, and all of them in 3D; and in
a report: one HTML file that holds everything and opens without a network."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from stereocal.figures.html import html_list, html_page, html_plot, html_table, paragraphs
from stereocal.figures.space import (
    NARROW,
    VIEWS,
    WIDE,
    above_or_below,
    eye_of,
    outline_of,
    set_scene,
)
from stereocal.figures.style import (
    FAINT,
    METHOD_COLOURS,
    NEUTRAL,
    add_trace,
    blank,
    evenly_drawn,
    line_of,
    n_drawn,
    with_gaps,
)
from stereocal.fit.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.fit.rig_file import RigFile
from stereocal.matching.view_groups import ViewFitter
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import digits, rounded
from stereocal.version import __version__

HEIGHT = 420
THINNEST, THICKEST = 2.0, 12.0
MAGNIFIED = 0.25
"""Length of a camera's pyramid over the largest distance of two cameras."""
HOW = (
    "Each pair was calibrated by itself; the pairs were fused by what their images tell; a robust "
    "adjustment of all images together left out what contradicts the others; a weighted least "
    "squares of pixels, known lengths and stated lenses gave poses, lenses and their covariance. "
    "Frames that follow each other count for less, by as much as their errors are alike."
)


def plot_rig_graph(rig: RigFile) -> go.Figure:
    """The cameras from above; a pair's line is the thicker the more bars both see, and dotted if
    the pair could not be calibrated by itself."""
    names, centres = list(rig.poses), _centres(rig)[:, [0, 2]]
    pairs = rig.about.pairs
    most = max((pair.bars for pair in pairs.values()), default=1)
    figure = blank(HEIGHT)
    for name, pair in pairs.items():
        if not {*pair.cameras} <= {*names}:
            continue
        third = [
            f"<br>in {error.camera}: {rounded(error.before)} px before, "
            f"{rounded(error.after)} after"
            for error in rig.about.third_camera_px
            if {*error.pair} == {*pair.cameras}
        ]
        first, second = (centres[names.index(camera)] for camera in pair.cameras)
        width = THINNEST + (THICKEST - THINNEST) * pair.bars / most
        colour, dash = METHOD_COLOURS["refined"], "solid"
        if pair.failed is not None:
            colour, dash = NEUTRAL, "dot"
        add_trace(
            figure,
            first + np.linspace(0.0, 1.0, 9)[:, None] * (second - first),
            f"{name}: {pair.bars} bars{''.join(third[:4])}",
            # Only markers can be clicked.
            marker={"size": THICKEST, "opacity": 0.0},
            line=line_of(colour, width, dash),
            opacity=0.75,
            customdata=[name] * 9,
            name=name,
            showlegend=False,
        )
    marker, text = {"size": 16, "color": METHOD_COLOURS["2d"]}, {"text": names, "textfont_size": 15}
    style = {"textposition": _name_sides(centres[:, 1]), "cliponaxis": False}
    add_trace(figure, centres, "camera %{text}", marker=marker, **text, **style, showlegend=False)
    figure.update_layout(margin={"t": 40})
    figure.update_xaxes(title_text=f"x of camera {rig.names[0]}, m")
    figure.update_yaxes(title_text="depth z, m", scaleanchor="x", zerolinecolor=FAINT)
    return figure


def describe_rig_graph(rig: RigFile) -> str:
    """The rig, its loops, and the bars of each pair."""
    pairs = [f"{name} {pair.bars} bars" for name, pair in rig.about.pairs.items()]
    seen = f"Bars that two cameras see: {', '.join(pairs)}."
    return " ".join(filter(None, [rig_sentence(rig), loops_sentence(rig), seen]))


def plot_cameras(
    rig: RigFile, recording: Recording | None = None, view: str = VIEWS[0], narrow: bool = False
) -> go.Figure:
    """All cameras in 3D, as pyramids, and the object in each frame; equal axes, metres.

    Args:
        recording: whose points are drawn; None: the cameras alone.
        view: one of `view_names`.
        narrow: for a screen of 420 px.
    """
    centres, figure = _centres(rig), blank(HEIGHT + 60)
    target = centres.mean(axis=0)
    if recording is not None:
        target = _add_objects(figure, rig, recording)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    for name, pose in rig.poses.items():
        outline = outline_of(rig.cameras[name], pose.inverse(), MAGNIFIED * float(apart.max()))
        line = line_of(METHOD_COLOURS["2d"], 4)
        add_trace(figure, outline, f"camera {name}", line=line, showlegend=False)
    marker = {"size": 4, "color": METHOD_COLOURS["2d"]}
    names = {"text": list(rig.poses), "textposition": _name_sides(-centres[:, 1])}
    add_trace(figure, centres, "camera %{text}", marker=marker, **names, showlegend=False)
    set_scene(figure, eye_of(view, rig, target, shape=NARROW if narrow else WIDE))
    return figure


def _add_objects(figure: go.Figure, rig: RigFile, recording: Recording) -> FloatArray:
    """The object in each frame: a line from end to end, of the points that two cameras see; the
    middle of all (3,)."""
    of_rig, first = recording.of_cameras(rig.names), rig.names[0]
    late = {name: rig.shift(first, name) for name in rig.names[1:]}
    of_rig = of_rig.shifted({name: offset for name, offset in late.items() if offset.is_shift})
    frames, images = of_rig.where(of_rig.usable).images()
    images = images[:, of_rig.object.longest]
    seen = np.flatnonzero((np.isfinite(images[..., 0]).sum(axis=2) >= 2).all(axis=1))
    shown = seen[evenly_drawn(len(seen))]  # before the fit: a page draws this each time
    fitter, pixels = ViewFitter(rig), images[shown].reshape(-1, *images.shape[2:])
    ends = fitter.fit(pixels, fitter.rays(pixels)).xyz.reshape(-1, 2, 3)
    fitted = np.isfinite(ends).all(axis=(1, 2))
    shown, ends = shown[fitted], ends[fitted]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    texts = [f"frame {f}<br>length {m:.4g} m" for f, m in zip(frames[shown], lengths, strict=True)]
    add_trace(
        figure,
        with_gaps(np.insert(ends, 1, ends.mean(axis=1), axis=1)),
        "%{text}",
        mode="lines",
        line=line_of(METHOD_COLOURS["refined"], 3),
        text=np.repeat(texts, 4),
        name=f"{recording.object.word.capitalize()}s ({n_drawn(len(seen))})",
    )
    return np.asarray(np.median(ends, axis=(0, 1)) if len(ends) else np.zeros(3))


def _name_sides(up: FloatArray) -> list[str]:
    return [f"{over} center" for over in above_or_below(up)]


def _centres(rig: RigFile) -> FloatArray:
    """(n, 3): of the cameras, in the reference's frame."""
    return np.array([pose.inverse().T for pose in rig.poses.values()])


def rig_report(rig: RigFile, name: str) -> str:
    """The text of the file."""
    words = describe_rig_graph(rig)
    pairs, cameras = (html_plot(draw(rig), words) for draw in (plot_rig_graph, plot_cameras))
    digest = rig.about.inputs.get("sha256")
    data = [f"SHA-256 of the recording's numbers: {digest}"] if digest else []
    sections = {
        "The pairs": pairs + paragraphs(*filter(None, [loops_sentence(rig)])),
        "The cameras": cameras + html_table(camera_table(rig)),
        "What to know": html_list(rig_notes(rig)),
        "How it was computed": paragraphs(f"stereocal {__version__}. {HOW}", *data),
    }
    return html_page(f"The rig of {name}", rig_sentence(rig), sections)


def lens_table(stated: Mapping[str, Camera | None], rig: RigFile | None = None) -> pd.DataFrame:
    """The lens of each camera, a camera a row: as stated, and as a rig refined it."""
    rows = []
    for name, camera in stated.items():
        row = {"Camera": name, "Image, px": "no lens yet"}
        if camera is not None:
            width, height = camera.image_size
            fisheye = ", fisheye" if camera.is_fisheye else ""
            error = f" ± {rounded(camera.uncertainty.fx)}" if camera.uncertainty else ""
            row["Image, px"] = f"{width} × {height}"
            row["Focal length, px"] = f"{camera.K[0, 0]:.1f}{error}{fisheye}"
        if rig is not None and name in rig.cameras:
            error = rounded(rig.standard_errors[name]["fx"])
            row["Refined, px"] = f"{rig.cameras[name].K[0, 0]:.1f} ± {error}"
        rows.append(row)
    return pd.DataFrame(rows).fillna("")


def camera_table(rig: RigFile) -> pd.DataFrame:
    """Poses and standard errors, a camera a row."""
    rows = {}
    errors = rig.about.image_errors_px
    for name, pose in rig.poses.items():
        sigmas = rig.standard_errors[name]
        turn = np.degrees([sigmas[f"turn_{axis}"] for axis in "xyz"])
        shift = [1000 * sigmas[axis] for axis in "xyz"]
        rows[name] = {
            "position, m": ", ".join(f"{value:.3f}" for value in pose.inverse().T),
            "rotation ±, °": ", ".join(map(rounded, turn)),
            "position ±, mm": ", ".join(map(rounded, shift)),
            "focal length, px": f"{rig.cameras[name].K[0, 0]:.1f} ± {rounded(sigmas['fx'])}",
            "image error, px": "unknown" if (px := errors.get(name)) is None else digits(px, 2),
        }
    return pd.DataFrame(rows).T.rename_axis("camera")
