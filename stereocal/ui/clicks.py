"""Points clicked in the pictures of two cameras or more, on the Apply page: frame by frame, with
the lines in the other pictures, the places proposed next, and what the points measure."""

import bisect
from collections.abc import Callable, Sequence
from functools import partial
from itertools import cycle, product
from typing import Any

import cv2
import numpy as np
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.point_text import LATEST_DLTDV, dltdv_table, sleap_table
from stereocal.frames.review import centre_at
from stereocal.frames.video.footage import Footage
from stereocal.matching.clicks import (
    FEWEST,
    Click,
    ClickMeasure,
    Clicks,
    Key,
    MeasuredClicks,
    Place,
    Source,
)
from stereocal.matching.following import corner_at, follow, nearest_clicks, velocity
from stereocal.matching.settled import Settled
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import camera_in_words
from stereocal.system.csv_text import csv_text
from stereocal.system.names import check_name
from stereocal.system.numbers import count
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, Number, choose, one_of, setting
from stereocal.ui.footage import Pictures
from stereocal.ui.holding import held_target, is_coloured
from stereocal.ui.messages import button, callback, fragment
from stereocal.ui.picker import KEYS, Mark, Pick, pick, shown
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import listed

COLOURS = ("#56B4E9", "#E69F00", "#2CC197", "#F0E442", "#FF7F50", "#CC79A7")
CORNER, TARGET = "The corner there", "The target there"
WAYS = ("Where I click", CORNER, TARGET)
_SETTLED, _NOTE = "clicks_settled", "clicks_note"
ON_KEYS = f"In a picture: {KEYS} The keys on buttons are letters while a name or a number is typed."
MOST_ACCEPTED = 50
"""Frames whose proposals are accepted at once: each is found from the last, so that small errors
add up, and somebody has to look."""
REFRESHED = 1.25
"""Growth of the number of points after which their noise is looked at again."""


def show_clicks(project: Project, measure: ClickMeasure) -> None:
    """The pictures, and all that is done in them."""
    footage = Pictures(project, measure.matching).show()
    if footage is not None:
        acts = ProjectClicks(project).acts
        if acts and acts[-1].pictures not in ([], [*footage.labels.values()]):
            before = escape_markdown(" and ".join(acts[-1].pictures))
            st.warning(f"The points so far were clicked in other pictures: {before}.")
        fragment(_Panel(project, footage, measure).show)()


class _Panel:
    """What one frame shows, and the acts on it."""

    def __init__(self, project: Project, footage: Footage, measure: ClickMeasure) -> None:
        self.project, self.footage, self.measure = project, footage, measure
        self.store, numbers = ProjectClicks(project), footage.numbers
        self.drawn = self.store.clicks.of_cameras(measure.matching.placed)
        self.cameras = [*footage.labels]
        field = partial(setting, project, tabs_own=True)
        self.frame_field: Field = field("clicks_frame", numbers[0], Number(numbers[0], numbers[-1]))
        self.track_field: Field = field("clicks_track", "point 1", _track_name)
        self.way_field: Field = field("clicks_to", WAYS[0], one_of(WAYS))

    def show(self) -> None:
        """The frame; a click draws this again, and nothing else of the page."""
        numbers = self.footage.numbers
        self.row = min(bisect.bisect_left(numbers, self.frame_field.value()), len(numbers) - 1)
        self.frame, self.track = numbers[self.row], str(self.track_field.value())
        self.clicks = self.store.clicks.of_cameras(self.measure.matching.placed)
        clicked, tracks = self.clicks.every, dict.fromkeys([*self.clicks.tracks, self.track])
        self.seen = [c for c in self.cameras if (self.frame, c, self.track) in clicked]
        self.colours = dict(zip(tracks, cycle(COLOURS), strict=False))
        self._choose()
        self._check_sizes()
        measured = self._measured(self.clicks)
        self.proposed, trial = self._propose(self.clicks, self.frame)
        self.may_go_on = bool(self.proposed) and not _in_doubt(self.proposed, trial)
        self._step()
        for camera, place in zip(self.cameras, cycle(st.columns(2)), strict=False):
            with place:
                self._show_picture(camera)
        st.caption(ON_KEYS)
        with st.container():
            if note := st.session_state.pop(_NOTE, ""):
                st.warning(escape_markdown(note))
            self._answer(measured, trial)
        with st.container(horizontal=True):
            self._offer()

    def _check_sizes(self) -> None:
        for camera in self.cameras:
            wanted = self.measure.matching.placed[camera].camera.image_size
            size = self.footage.grey(camera, self.frame).shape[::-1]
            if size != wanted:
                raise StereocalError(
                    f"The pictures of {camera_in_words(camera)} have {size[0]}x{size[1]} px, its "
                    f"parameters are for {wanted[0]}x{wanted[1]} px: give those of this camera, as "
                    "recorded."
                )

    def _measured(self, clicks: Clicks) -> MeasuredClicks | None:
        if not clicks.are_points:
            return None
        how, size = self.measure, len(clicks.every)
        made_from = how.matching.digest, how.measuring.digest, repr(how.stated)
        settled: tuple[Any, int, Settled] | None = st.session_state.get(_SETTLED)
        if (
            settled is None
            or settled[0] != made_from
            or not settled[1] <= size <= REFRESHED * settled[1]
        ):
            settled = st.session_state[_SETTLED] = made_from, size, how.settled(clicks)
        return how.measured(clicks, settled[2])

    def _propose(self, clicks: Clicks, frame: int) -> tuple[list[Click], MeasuredClicks | None]:
        """The next places of tracks that have none in a frame, where the images show them and
        agree; and what all points measure with them."""
        proposed, origins = [], clicks.origins
        for camera, track in product(self.cameras, clicks.tracks):
            near = nearest_clicks(clicks.along(track, camera), frame)
            if (frame, camera, track) in clicks.every or not near:
                continue
            if near[0].frame in self.footage.numbers:
                earlier, later = (self.footage.grey(camera, k) for k in (near[0].frame, frame))
                if (position := follow(earlier, later, near, frame)) is not None:
                    origin = origins[near[0].key]
                    proposed.append(Click(frame, camera, track, *position, "followed", origin))
        trial = self._measured(clicks.placed(proposed))
        if trial and (beyond := trial.beyond(frame) & {click.track for click in proposed}):
            proposed = [click for click in proposed if click.track not in beyond]
            trial = self._measured(clicks.placed(proposed))
        return proposed, trial

    def _choose(self) -> None:
        """The frame and the track: also of pictures that cannot be used."""
        left, middle, right = st.columns([2, 1, 1])
        if len(self.footage.numbers) > 1:
            self.frame_field.slider("Frame", left)
        tracks = [*self.colours]
        widget = {"accept_new_options": True, **self.track_field.widget("index")}
        widget["index"] = tracks.index(self.track)
        middle.selectbox("Track (type a new name)", tracks, **widget)
        self.way_field.menu("A click goes to", right)

    def _step(self) -> None:
        """The buttons."""
        numbers = self.footage.numbers
        before, after = numbers[max(self.row - 1, 0)], numbers[self.row + 1 : self.row + 2]
        clicked = [(self.frame, camera, self.track) for camera in self.seen]
        onward = after[0] if after else self.frame
        accept = f"Accept {len(self.proposed)} and go on" if self.proposed else "Accept and go on"
        last = {camera for act in self.store.acts[-1:] for camera in act.cameras}
        can_undo = not last.isdisjoint(self.measure.matching.placed)
        presses: tuple[tuple[str, str, bool, Callable[[], object]], ...] = (
            ("Back", "b", before != self.frame, partial(self.frame_field.set, before)),
            ("Forward", "f", bool(after), partial(self.frame_field.set, onward)),
            (accept, "a", bool(self.proposed), partial(self._accept, onward)),
            ("Accept until in doubt", "g", self.may_go_on, self._accept_on),
            ("Remove it", "x", bool(clicked), partial(self._place, [], clicked)),
            ("Undo", "u", can_undo, self.store.undo),
        )
        with st.container(horizontal=True):
            for label, key, may, act in presses:
                first = may and key == "a"
                button(label, f"clicks_{key}", act, first=first, shortcut=key, disabled=not may)

    def _accept(self, onward: int) -> None:
        self._place(self.proposed)
        self.frame_field.set(onward)

    def _accept_on(self) -> None:
        """Accept the proposals of this frame and of those after it as one act, up to a frame in
        which a point is in doubt, or has been clicked."""
        accepted, clicks, frame = list[Click](), self.clicks, self.frame
        wanted, note = {click.key[1:] for click in self.proposed}, ""
        for frame in self.footage.numbers[self.row :]:
            every, trial = self._propose(clicks, frame)
            chosen = [click for click in every if click.key[1:] in wanted]
            placed = {key[1:] for key in clicks.placed(chosen).every if key[0] == frame}
            doubtful = {track for _, track in wanted - placed} | _in_doubt(chosen, trial)
            if doubtful:
                names = listed(sorted(doubtful))
                note = f"Frame {frame} was not accepted. In doubt there: {names}."
            elif len(accepted) >= MOST_ACCEPTED * len(wanted):
                note = f"Accepted in {MOST_ACCEPTED} frames: look at them before you go on."
            if note or not chosen:
                break
            accepted, clicks = [*accepted, *chosen], clicks.placed(chosen)
        st.session_state[_NOTE] = note
        self._place(accepted)
        self.frame_field.set(frame)

    def _place(self, placed: Sequence[Click], removed: Sequence[Key] = ()) -> None:
        self.store.act(Act([*placed], [*removed], [*self.footage.labels.values()]))

    def _show_picture(self, camera: str) -> None:
        label, frame, track = self.footage.labels[camera], self.frame, self.track
        st.markdown(f"**{escape_markdown(camera.capitalize())}** · {escape_markdown(label)}")
        marks = [
            Mark(click.track, click.u, click.v, None, self.colours[click.track], shape)
            for clicks, shape in ((self.clicks.every.values(), "cross"), (self.proposed, "dashed"))
            for click in clicks
            if click.key[:2] == (frame, camera)
        ]
        lines = []
        for other in self.cameras:
            click = self.clicks.every.get((frame, other, track))
            if other != camera and click is not None:
                speed = velocity(nearest_clicks(self.clicks.along(track, other), frame))
                curve = self.measure.curve(click, camera, speed)
                lines.append((curve, self.colours[track]))
        jpeg = self.footage.picture(camera, frame)
        image = shown(f"{label} {frame}", self.footage.grey(camera, frame), jpeg)
        description = f"Frame {frame} of {camera_in_words(camera)}."
        take = partial(callback(self._take), camera)
        pick(image, marks, description, f"clicks_{camera}", False, take, lines, track)

    def _take(self, camera: str, click: Pick) -> None:
        """Place a point, or keep why not; one in a picture that is no longer shown is ignored."""
        if click.id != f"{self.footage.labels[camera]} {self.frame}":
            return
        way, position = WAYS[0] if click.raw else self.way_field.value(), (click.u, click.v)
        try:
            position = self._snapped(camera, way, position)
        except StereocalError as error:
            st.session_state[_NOTE] = str(error)
            return
        source: Source = "clicked" if way == WAYS[0] else "snapped"
        self._place([Click(self.frame, camera, self.track, *position, source)])

    def _snapped(self, camera: str, way: str, position: tuple[float, float]) -> tuple[float, float]:
        image = self.footage.grey(camera, self.frame)
        if way == TARGET:
            target, lens = held_target(self.project), self.measure.matching.placed[camera].camera
            if is_coloured(target):
                content = np.frombuffer(self.footage.picture(camera, self.frame), np.uint8)
                image = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)
            centre = centre_at(image, position, False, target, lens)
            return centre.u, centre.v
        return corner_at(image, position) if way == CORNER else position

    def _answer(self, measured: MeasuredClicks | None, trial: MeasuredClicks | None) -> None:
        """What the point of the track measures in this frame, or would, or what to click next."""
        place = Place(self.track, self.frame)
        measurement = measured if len(self.seen) >= FEWEST else trial
        if measurement is None or place not in measurement.rows:
            st.info(escape_markdown(_next_click(self.track, self.seen, self.cameras)))
        else:
            show, proposed = st.success, ""
            if len(self.seen) < FEWEST:
                show, proposed = st.info, "proposed: "
            elif self.track in measurement.beyond(self.frame):
                show = st.warning
            words = escape_markdown(f"{proposed}{measurement.sentence(place)}")
            show(f"**{escape_markdown(self.track)}**, {words}")
        if trial is None:
            return
        tracks = dict.fromkeys(row.track for row in trial.rows if row.track != self.track)
        others = {f"{track}, in the same frame": Place(track, self.frame) for track in tracks}
        others |= {str(row): row for row in sorted(trial.rows) if row != place}
        left, right = st.columns([2, 1])
        lines = []
        if (before := trial.previous(place)) is not None:
            lines.append(trial.in_words((before, place)))
        if others:
            key, title = "clicks_other", "Distance to"
            to = choose(self.project, key, title, others, place=right, as_menu=True)
            lines.append(trial.in_words((place, others[to])))
            if measured and others[to].frame == self.frame:
                lines.append(measured.in_words(*measured.common(self.track, others[to].track)))
        lines.append(trial.timing)
        left.markdown("  \n".join(map(escape_markdown, filter(None, dict.fromkeys(lines)))))

    def _offer(self) -> None:
        """The points of each camera, and all that the page makes of them."""
        clicks = self.clicks
        total = count(len(clicks.every), "click")
        if clicks.are_points and st.button(f"Match and measure all ({total})", "clicks_all"):
            st.rerun()
        if clicks.every != self.drawn.every and self.drawn.are_points:
            st.caption("What is shown below is of the points before.")
        with st.popover("Download the clicks"):
            cameras = [*self.measure.matching.placed]
            tables = clicks.tables(cameras)
            files = {f"{c}.csv": partial(csv_text, table) for c, table in tables.items()}
            if clicks.last_frame <= LATEST_DLTDV:
                files["xypts.csv (DLTdv8)"] = partial(dltdv_table, clicks, cameras)
            files |= {f"sleap_{c}.csv (SLEAP)": partial(sleap_table, clicks, c) for c in tables}
            for number, (label, text) in enumerate(files.items()):
                offer(label, text, label.split(" ")[0], f"clicks_file_{number}")


def _in_doubt(proposed: Sequence[Click], trial: MeasuredClicks | None) -> set[str]:
    """The tracks of which no point is measured where one is proposed: the images of two cameras
    have to agree."""
    places = {Place(click.track, click.frame) for click in proposed}
    return {place.track for place in places - {*(trial.rows if trial else ())}}


def _next_click(track: str, seen: Sequence[str], cameras: Sequence[str]) -> str:
    if not seen:
        return f"Click {track} in one of the pictures."
    if len(seen) == 1:
        others = " or ".join(camera for camera in cameras if camera != seen[0])
        return f"Now click {track} in the {others} picture, near the line."
    return f"The rays of {track} do not meet in front of the cameras."


def _track_name(value: Any) -> str:
    """A name that is stored and shown as it is."""
    if not isinstance(value, str):
        raise TypeError(value)
    return check_name("A track", value.strip())
