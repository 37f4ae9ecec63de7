"""A child process that ends when its parent ends, however the parent ends.

`python -m stereocal.system.child_process MODULE ...` runs a module in one. Its stdin is a pipe that
the parent alone holds open; it is watched before the module is imported, which takes seconds.
"""

import multiprocessing
import os
import runpy
import sys
import threading
from collections.abc import Callable
from functools import partial


def end_with_parent() -> None:
    """In a process started by `multiprocessing`: exit as soon as the parent has ended.

    Otherwise the worker of a killed command waits for work forever: it holds both ends of the pipe
    that work comes through, so that it never sees the pipe's end.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        exit_after(parent.join)


def exit_after(wait: Callable[[], object]) -> None:
    """Exit at once when `wait` returns, which a thread of its own calls.

    A pipe that the parent holds open tells of its end. Linux' death signal does not: it comes when
    the thread ends that started the child, and those of a server do.
    """

    def watch() -> None:
        wait()
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="parent").start()


if __name__ == "__main__":
    exit_after(partial(os.read, 0, 1))
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
