"""The search for targets in photographs of any cameras, put together moment by moment."""

from collections.abc import Callable, Mapping

from stereocal.detection.target import Target
from stereocal.frames import several
from stereocal.frames.search import STAGES, pack_detection, unpack_detection
from stereocal.intrinsics.files import pack_board, unpack_board
from stereocal.intrinsics.stereo_boards import BOARDS_STAGE, boards_everywhere
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import Camera
from stereocal.system.records import plain
from stereocal.ui import jobs
from stereocal.ui.boards import held_board
from stereocal.ui.holding import ask_what_is_held, holds_board

Held = Target | BoardPattern


def ask_held(
    store: ProjectPhotographs, moments: several.Moments, fold: bool
) -> tuple[Held | None, bool]:
    """What is held, and whether it can be searched for: of a board, its size must be stated.

    Args:
        fold: once it is said.
    """
    pairs = several.pairs_of(moments, *[*next(iter(moments.values()))][:2])
    held: Held | None = ask_what_is_held(store, pairs, fold)
    stated = True
    if holds_board(store.project):
        held, stated = held_board(store.project)
    return held, held is not None and stated


def moment_search(
    store: ProjectPhotographs,
    cameras: Mapping[str, Camera],
    moments: several.Moments,
    held: Held | None,
    keep: Callable[[several.Everywhere, str], None],
    **more: float | None,
) -> jobs.Work:
    """The search, for a button.

    Args:
        keep: stores what was found, and the digest of the search.
        more: what else it is a result of.
    """
    files = {name: file.name for name, file in store.photographs.items()}
    about = {
        "photographs": [
            {"frame": k, **{c: files[n] for c, n in own.items()}} for k, own in moments.items()
        ],
        "cameras": {name: camera.to_json() for name, camera in cameras.items()},
        "target": None if held is None else [type(held).__name__, plain(held)],
        **more,
    }

    def run(job: jobs.Job) -> bool:
        control = job.executor, job.begin, job.progress, lambda: job.cancelled
        photographs = store.photographs
        if isinstance(held, BoardPattern):
            boards = job.found_before(pack_board, unpack_board)
            found = boards_everywhere(moments, photographs, cameras, held, *control, boards)
        elif held is not None:
            seen = job.found_before(pack_detection, unpack_detection)
            found = several.find_everywhere(moments, photographs, cameras, held, *control, seen)
        else:
            found = None
        if found is not None:
            keep(found, job.work.digest)
        return found is not None

    stages = (BOARDS_STAGE,) if isinstance(held, BoardPattern) else STAGES
    return jobs.Work(store.project, "photographs", stages, run, jobs.digest_of(about))
