"""Every action on projects, struck at every single thing that it does to the disk.

python -m benchmarks.failing_disk

Per action: the calls that change the disk; of as many tries on a disk that is full at one call, how
many were refused with a sentence and how many were done all the same (what failed was the removal
of what is not needed); of as many deaths of the server, how many left all as before and how many
all as after. A try that lost something ends the run with an error.
"""

from __future__ import annotations

from tests.projects.test_failing_disk import ACTIONS, Struck, quick_folder, strike_all


def main() -> None:
    """Strike everything everywhere."""
    sums = [Struck(), Struck(), Struck()]
    print(f"{'action':48} calls  full: refused  done  died: before  after")
    for name in ACTIONS:
        with quick_folder() as folder:
            found = strike_all(folder, name, lambda calls: range(1, calls + 1))
        full, _, died = found
        print(
            f"{name:48} {full.calls:5} {full.refused:14} {full.done_all_the_same:5} "
            f"{died.undone:13} {died.calls - died.undone:6}",
            flush=True,
        )
        for total, one in zip(sums, found, strict=True):
            for field in vars(total):
                setattr(total, field, getattr(total, field) + getattr(one, field))
    for what, total in zip(("full disk", "read-only disk", "deaths"), sums, strict=True):
        print(f"{what}: {total}")


if __name__ == "__main__":
    main()
