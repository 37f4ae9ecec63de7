"""The points that a person clicked in both images of a project, as acts that can be undone."""

from dataclasses import dataclass, field
from typing import Any

from stereocal.errors import damaged
from stereocal.matching.clicks import Click, Clicks, Key
from stereocal.projects.contents import CLICKS
from stereocal.projects.database import DamagedError
from stereocal.projects.project import Project, ProjectPart
from stereocal.system.records import of_plain, plain


@dataclass(frozen=True)
class Act:
    """What a person did at once."""

    placed: list[Click]
    """Each in place of one of its track in its image."""
    removed: list[Key] = field(default_factory=list)
    pictures: list[str] = field(default_factory=list)
    """What those of each camera are called."""

    def __post_init__(self) -> None:
        if any(
            abs(click.frame) > 2**53 or max(abs(click.u), abs(click.v)) > 1e9
            for click in self.placed
        ):
            raise ValueError(self)

    @property
    def cameras(self) -> set[str]:
        """The cameras in whose pictures it was done."""
        return {camera for _, camera, _ in [*self.removed, *(click.key for click in self.placed)]}


class ProjectClicks(ProjectPart):
    """The clicks of one project. Each act is on disk when its method returns."""

    @property
    def of_pictures(self) -> Project:
        """What holds the photographs given for clicking: a project of its own in the same file."""
        return Project(self.database.of_page(CLICKS))

    @property
    def acts(self) -> list[Act]:
        """All that can be undone, the last one last."""
        stored = self.database.values(CLICKS)
        with damaged("The points clicked here are damaged.", DamagedError):
            # By the names that `act` gives: an untrusted file may have others.
            return [of_plain(_named(stored[f"{int(name):09d}"]), Act) for name in sorted(stored)]

    @property
    def clicks(self) -> Clicks:
        """The points as they are after all acts."""
        clicks: dict[Key, Click] = {}
        for act in self.acts:
            for key in act.removed:
                clicks.pop(key, None)
            clicks |= {click.key: click for click in act.placed}
        return Clicks(clicks)

    def act(self, act: Act) -> None:
        """Store an act."""
        with self.database.transaction():
            last = max(self.database.values(CLICKS), default="0")
            self.database.keep_values(CLICKS, {f"{int(last) + 1:09d}": plain(act)})

    def undo(self) -> None:
        """Undo the last act, if any."""
        with self.database.transaction() as db:
            part = self.database.scope + CLICKS
            last = "(SELECT max(name) FROM value WHERE part = ?)"
            db.execute(f"DELETE FROM value WHERE part = ? AND name = {last}", [part, part])


def _named(act: Any) -> Any:
    """A stored act; earlier versions kept a blank where they cut a name."""
    if not isinstance(act, dict):
        return act
    placed = [{**click, "track": click["track"].strip()} for click in act["placed"]]
    removed = [(frame, camera, track.strip()) for frame, camera, track in act.get("removed", [])]
    return {**act, "placed": placed, "removed": removed}
