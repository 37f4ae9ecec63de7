"""Settings that all tests share."""

import gc
import signal

from hypothesis import settings

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would every command
# that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# No deadline: a first call may compile. The same examples in every run: a failure is a change.
settings.register_profile("stereocal", deadline=None, derandomize=True)
settings.load_profile("stereocal")


def pytest_collection_finish() -> None:
    """What was imported stays: the garbage collector need not look through it again and again."""
    gc.collect()
    gc.freeze()
