"""What is random, long or repeated; `make soak` runs those that are marked `soak`.

With STEREOCAL_SOAK=short there are fewer repeats: it takes less time than the other tests.
"""

import os


def repeats(short: int, whole: int) -> int:
    """How many times: few in a short soak."""
    return short if os.environ.get("STEREOCAL_SOAK") == "short" else whole
