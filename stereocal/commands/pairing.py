"""How the photographs of two cameras are paired by a command."""

from collections.abc import Mapping
from pathlib import Path

from stereocal.commands.console import Options
from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pairing
from stereocal.frames.proposal import WAYS, Choice, Way, propose
from stereocal.system.taken import Taken, read_taken

PAIR_BY: Options = {
    "--pair-by": {
        "choices": [*WAYS],
        "help": "how photographs belong together (default: by name, else by the time taken, else "
        "in order if both cameras have as many)",
    }
}


def taken_of(photographs: Mapping[str, Path]) -> dict[str, Taken]:
    """When each photograph was taken, by its header, its name or its file's time."""
    found = {}
    for name, path in photographs.items():
        try:
            modified = path.stat().st_mtime
        except OSError:  # reported where the photograph is read
            modified = None
        found[name] = read_taken(path, name, modified)
    return found


def pairing_of(photographs: Mapping[str, Path], source: Path, way: Way | None = None) -> Pairing:
    """The pairs of photographs.

    Args:
        way: how to pair, if it is stated.

    Raises:
        StereocalError: there are no pairs in this way; or, if none is stated, no way is sure.
    """
    proposal = propose(taken_of(photographs), Choice(way))
    pairing = proposal.pairing
    if way is not None and proposal.way != way:
        raise StereocalError(f"{source}: no two photographs can be paired by --pair-by {way}.")
    if not pairing.pairs:
        raise StereocalError(f"{source}: {pairing.sentence}")
    if pairing.ambiguous and way is None:
        ways = " or ".join(f"--pair-by {each}" for each in proposal.ways)
        raise StereocalError(f"{source}: {pairing.sentence} Or state how to pair them: {ways}.")
    return pairing
