"""The points that a person clicked in both images of a project, as acts that can be undone."""

from collections.abc import Collection, Sequence

from stereocal.errors import DAMAGED
from stereocal.matching.clicks import Click, Clicks
from stereocal.projects.database import DamagedError
from stereocal.projects.project import ProjectPart
from stereocal.system.records import of_plain, plain

CLICKS = "clicks"
Key = tuple[int, str, str]


class ProjectClicks(ProjectPart):
    """The clicks of one project. Each act is on disk when its method returns."""

    @property
    def acts(self) -> int:
        """How many can be undone."""
        return len(self.database.values(CLICKS))

    @property
    def clicks(self) -> Clicks:
        """The points as they are after all acts."""
        found: dict[object, Click] = {}
        try:
            for _, act in sorted(self.database.values(CLICKS).items()):
                for key in act["removed"]:
                    found.pop(tuple(key), None)
                for click in of_plain(act["placed"], list[Click]):
                    found[click.key] = click
        except DAMAGED as error:
            raise DamagedError("The points clicked here are damaged.") from error
        return Clicks.of(found.values())

    def place(self, placed: Sequence[Click], removed: Collection[Key] = ()) -> None:
        """Place points, each in place of one of its track in its image, and remove others."""
        if not placed and not removed:
            return
        with self.database.transaction():
            last = max(self.database.values(CLICKS), default="0")
            act = {"placed": plain(list(placed)), "removed": [list(key) for key in removed]}
            self.database.keep_values(CLICKS, {f"{int(last) + 1:09d}": act})

    def undo(self) -> None:
        """Undo the last act, if any."""
        with self.database.transaction() as db:
            part = self.database.scope + CLICKS
            last = "(SELECT max(name) FROM value WHERE part = ?)"
            db.execute(f"DELETE FROM value WHERE part = ? AND name = {last}", [part, part])
