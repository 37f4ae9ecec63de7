"""Points clicked in the pictures of both cameras, on the Apply page: frame by frame, with the line
in the other picture, the places proposed next, and what the points measure."""

from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import cv2
import numpy as np
import streamlit as st

from stereocal.detection.target import Bar2x2
from stereocal.errors import StereocalError, can_be_shown
from stereocal.formats.click_tables import dltdv_table, sleap_table
from stereocal.frames.review import centre_at
from stereocal.frames.video.footage import Footage
from stereocal.matching.clicks import (
    Click,
    ClickMeasure,
    Clicks,
    MeasuredClicks,
    Place,
    Settled,
    Source,
)
from stereocal.matching.following import corner_at, follow, nearest_clicks, velocity
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.system.numbers import count
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, one_of, setting
from stereocal.ui.footage import ask_footage, footage_of
from stereocal.ui.holding import held_target
from stereocal.ui.messages import callback, fragment
from stereocal.ui.picker import Line, Mark, Pick, pick, shown
from stereocal.ui.texts import escape_markdown

COLOURS = ("#56B4E9", "#E69F00", "#2CC197", "#F0E442", "#FF7F50", "#CC79A7")
RAW, CORNER, TARGET = "Where I click", "The corner there", "The target there"
_SETTLED = "clicks_settled"
_OTHER_SIZE = (
    "The pictures of the {} camera have {}x{} px, its parameters are for {}x{} px: give the "
    "pictures as recorded, or exchange the cameras."
)
REFRESHED = 1.25
"""Growth of the number of points after which their noise is looked at again."""


def show_clicks(project: Project, measure: ClickMeasure) -> None:
    """The pictures, and all that is done in them."""
    footage = footage_of(project)
    ask_footage(project, footage)
    if footage is not None:
        fragment(_Panel(project, footage, measure).show)()


class _Panel:
    """What one frame shows, and the acts on it."""

    def __init__(self, project: Project, footage: Footage, measure: ClickMeasure) -> None:
        self.project, self.footage, self.measure = project, footage, measure
        self.store = ProjectClicks(project)
        own = partial(setting, project, tabs_own=True)
        first = footage.numbers[0]
        self.at: Field = own("clicks_frame", first, one_of(footage.numbers))
        self.track: Field = own("clicks_track", "point 1", _track_name)
        self.to: Field = own("clicks_to", RAW, one_of((RAW, CORNER, TARGET)))

    def show(self) -> None:
        """The frame; a click draws this again, and nothing else of the page."""
        frame, track, clicks = self.at.value(), self.track.value(), self.store.clicks
        for camera in CAMERAS:
            placed = self.measure.matching.placed[camera].camera
            size = self.footage.grey(camera, frame).shape[::-1]
            if size != placed.image_size:
                raise StereocalError(_OTHER_SIZE.format(camera, *size, *placed.image_size))
        measured = self._measured(clicks)
        proposed, trial = self._proposed(clicks, frame)
        self._choose(clicks, frame, track, proposed)
        for camera, place in zip(CAMERAS, st.columns(2), strict=True):
            with place:
                self._show_picture(camera, clicks, frame, track, proposed)
        with st.container():
            self._answer(clicks, measured, trial, Place(track, frame))
        with st.container(horizontal=True):
            self._offer(clicks)

    def _measured(self, clicks: Clicks) -> MeasuredClicks | None:
        if not clicks.has_pairs:
            return None
        how, size = self.measure, len(clicks.every)
        about = how.matching.digest, how.measuring.digest, repr(how.stated)
        kept: tuple[Any, int, Settled] | None = st.session_state.get(_SETTLED)
        if kept is None or kept[0] != about or not kept[1] <= size <= REFRESHED * kept[1]:
            kept = about, size, how.settled(clicks)
            st.session_state[_SETTLED] = kept
        return how.measured(clicks, kept[2])

    def _proposed(self, clicks: Clicks, frame: int) -> tuple[list[Click], MeasuredClicks | None]:
        """The next places of tracks that have none in this frame, where the images show them and
        agree; and what all points measure with them."""
        found = []
        for camera in CAMERAS:
            there = {each.track for each in clicks.at(frame, camera)}
            for track in clicks.tracks:
                near = nearest_clicks(clicks.along(track, camera), frame)
                if track in there or not near or near[0].frame not in self.footage.numbers:
                    continue
                before, now = (self.footage.grey(camera, k) for k in (near[0].frame, frame))
                if (next_one := follow(before, now, near, frame)).is_seen:
                    found.append(Click(frame, camera, track, next_one.u, next_one.v, "followed"))
        trial = self._measured(Clicks.of([*clicks.every.values(), *found]))
        if trial and (beyond := trial.beyond(frame) & {each.track for each in found}):
            found = [each for each in found if each.track not in beyond]
            trial = self._measured(Clicks.of([*clicks.every.values(), *found]))
        return found, trial

    def _choose(self, clicks: Clicks, frame: int, track: str, proposed: Sequence[Click]) -> None:
        """The frame, the track, and the buttons."""
        numbers, tracks = self.footage.numbers, list(dict.fromkeys([*clicks.tracks, track]))
        at, named, to = st.columns([2, 1, 1])
        if len(numbers) > 1:
            at.select_slider("Frame", numbers, **self.at.widget())
        named.selectbox(
            "Track (type a new name)", tracks, accept_new_options=True, **self.track.widget()
        )
        to.selectbox("A click goes to", [RAW, CORNER, TARGET], **self.to.widget())
        row = numbers.index(frame)
        before, after = (numbers[min(max(row + by, 0), len(numbers) - 1)] for by in (-1, 1))
        here = [each.key for c in CAMERAS for each in clicks.at(frame, c) if each.track == track]
        accept = f"Accept {len(proposed)} and go on" if proposed else "Accept and go on"
        with st.container(horizontal=True):
            for label, key, shortcut, act, may in (
                ("Back", "back", "b", partial(self.at.set, before), before != frame),
                ("Forward", "forward", "f", partial(self.at.set, after), after != frame),
                (accept, "accept", "a", partial(self._accept, proposed, after), bool(proposed)),
                ("Remove it", "remove", "x", partial(self.store.place, (), here), bool(here)),
                ("Undo", "undo", "u", self.store.undo, self.store.acts > 0),
            ):
                kind: Literal["primary", "secondary"] = "primary" if proposed else "secondary"
                st.button(
                    label,
                    key=f"clicks_{key}",
                    shortcut=shortcut,
                    disabled=not may,
                    on_click=callback(act),
                    type=kind if key == "accept" else "secondary",
                )

    def _accept(self, proposed: Sequence[Click], after: int) -> None:
        self.store.place(proposed)
        self.at.set(after)

    def _show_picture(
        self, camera: CameraName, clicks: Clicks, frame: int, track: str, proposed: Sequence[Click]
    ) -> None:
        other = next(each for each in CAMERAS if each != camera)
        st.markdown(f"**{camera.capitalize()}** · {escape_markdown(self.footage.labels[camera])}")
        tracks = clicks.tracks
        names = dict.fromkeys([*tracks, track])
        colour = {each: COLOURS[k % len(COLOURS)] for k, each in enumerate(names)}
        marks = [
            Mark(each.track, each.u, each.v, None, colour[each.track], shape)
            for own, shape in ((clicks.at(frame, camera), "cross"), (proposed, "dashed"))
            for each in own
            if each.camera == camera
        ]
        lines = []
        for each in clicks.at(frame, other):
            if each.track == track:
                speed = velocity(nearest_clicks(clicks.along(track, other), frame))
                curve = self.measure.curve(each, speed)
                lines.append(Line(curve.tolist(), colour[track]))
        name = f"{self.footage.labels[camera]} {frame}"
        image = shown(name, self.footage.grey(camera, frame), self.footage.picture(camera, frame))
        about = (
            f"Frame {frame} of the {camera} camera. Arrow keys move, plus and minus zoom, Enter "
            f"places {track} at the cross-hair in the middle."
        )
        click = partial(self._take, camera, frame, track)
        pick(image, marks, about, f"clicks_{camera}", False, click, lines)

    def _take(self, camera: CameraName, frame: int, track: str, click: Pick) -> None:
        """Place a point (a callback); one in a picture that is no longer shown is ignored."""
        if click.id != f"{self.footage.labels[camera]} {frame}":
            return

        def place() -> None:
            to, at = RAW if click.raw else self.to.value(), (click.u, click.v)
            if to == CORNER:
                at = corner_at(self.footage.grey(camera, frame), at)
            elif to == TARGET:
                content = np.frombuffer(self.footage.picture(camera, frame), np.uint8)
                target = held_target(self.project)
                grey = isinstance(target, Bar2x2)
                image = cv2.imdecode(content, not grey)
                lens = self.measure.matching.placed[camera].camera
                centre = centre_at(np.asarray(image), at, False, target, lens)
                at = centre.u, centre.v
            source: Source = "clicked" if to == RAW else "snapped"
            self.store.place([Click(frame, camera, track, *at, source)])

        callback(place)()

    def _answer(
        self,
        clicks: Clicks,
        measured: MeasuredClicks | None,
        trial: MeasuredClicks | None,
        place: Place,
    ) -> None:
        """What the point of the track measures in this frame, or would, or what to click next."""
        seen = [c for c in CAMERAS if (place.frame, c, place.track) in clicks.every]
        if trial is None or place not in trial.rows:
            st.info(escape_markdown(_next_click(place.track, seen)))
        else:
            show = st.warning if place.track in trial.beyond(place.frame) else st.success
            show, proposed = (show, "") if len(seen) > 1 else (st.info, "proposed: ")
            words = escape_markdown(f"{proposed}{trial.sentence(place)}")
            show(f"**{escape_markdown(place.track)}**, {words}")
        if trial is None:
            return
        others = {f"{t}, in the same frame": Place(t, place.frame) for t in trial.tracks}
        others |= {str(each): each for each in sorted(trial.rows) if each != place}
        others.pop(f"{place.track}, in the same frame", None)
        left, right = st.columns([2, 1])
        lines = []
        if (before := trial.previous(place)) is not None:
            lines.append(trial.in_words((before, place)))
        if others:
            to = choose(
                self.project, "clicks_other", "Distance to", others, place=right, as_menu=True
            )
            lines.append(trial.in_words((place, others[to])))
            if measured and others[to].frame == place.frame:
                lines.append(measured.in_words(*measured.common(place.track, others[to].track)))
        left.markdown("  \n".join(map(escape_markdown, filter(None, dict.fromkeys(lines)))))

    def _offer(self, clicks: Clicks) -> None:
        """The points of each camera, and all that the page makes of them."""
        total = count(len(clicks.every), "click")
        if clicks.has_pairs and st.button(f"Match and measure all ({total})", "clicks_all"):
            st.rerun()
        with st.popover("Download the clicks"):
            for camera, table in clicks.tables().items():
                name = f"{camera}.csv"
                offer(name, table.to_csv(index=False), name, f"clicks_csv_{camera}")
            dltdv = partial(dltdv_table, clicks)
            offer("xypts.csv (DLTdv8)", dltdv, "xypts.csv", "clicks_dltdv")
            for camera in CAMERAS:
                sleap, name = partial(sleap_table, clicks, camera), f"sleap_{camera}.csv"
                offer(f"{name} (SLEAP)", sleap, name, f"clicks_sleap_{camera}")


def _next_click(track: str, seen: Sequence[CameraName]) -> str:
    if not seen:
        return f"Click {track} in one of the pictures."
    if len(seen) == 1:
        other = next(each for each in CAMERAS if each != seen[0])
        return f"Now click {track} in the {other} picture, near the line."
    return f"The rays of {track} do not meet in front of both cameras."


def _track_name(value: Any) -> str:
    """A name that is stored and shown as it is."""
    if not isinstance(value, str) or not value.strip() or not can_be_shown(value):
        raise ValueError(value)
    return value.strip()[:40]
