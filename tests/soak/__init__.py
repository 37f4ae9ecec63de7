"""What is random, long or repeated; `make soak` runs those that are marked `soak`.

With STEREOCAL_SOAK=short there are fewer repeats, and none of the `further` cases: it takes a
quarter of the time of the other tests.
"""

import os

SHORT = os.environ.get("STEREOCAL_SOAK") == "short"


def repeats(short: int, whole: int) -> int:
    """How many times: few in a short soak."""
    return short if SHORT else whole
