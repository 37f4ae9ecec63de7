"""Files of every kind made hostile, through every reader: `python -m benchmarks.hostile`.

Each input is made from a seed, the reader's name and a number alone, so it can be made again:

    python -m benchmarks.hostile --inputs 100000 --seed 1 --failures found/
    python -m benchmarks.hostile --show "photograph, PNG" 17 --seed 1 > bad.png

Worker processes with bounded memory read them. An input may be accepted or refused with a sentence.
Another exception, an end of the process, more than `MOST_SECONDS` of its time or more memory than
allowed is a failure; it is saved with what happened.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from stereocal.errors import LONGEST, StereocalError
from tests.soak.mutations import from_nothing, mutated
from tests.soak.readers import Reader, readers

BATCH = 50
MOST_SECONDS = 5.0
"""Of processor time. The watch on the wall allows more: other work may hold a process up."""
PATIENCE_S = 30.0
ROOM = 2_000_000_000
"""Bytes of addresses beyond those of a worker that has read everything once."""
MEGAPIXELS = "20"
FROM_NOTHING = 0.1


def made(reader: Reader, seed: int, at: int) -> bytes:
    """The input of this number."""
    random = Random(f"{seed}/{reader.name}/{at}")
    if random.random() < FROM_NOTHING:
        return from_nothing(reader.kind, random)
    seeds = reader.seeds()
    return mutated(reader.kind, random, random.choice(seeds), random.choice(seeds))


@dataclass
class Found:
    """What became of the inputs of one reader."""

    accepted: int = 0
    refused: int = 0
    failures: list[tuple[int, str]] = field(default_factory=list)
    slowest: tuple[float, int] = (0.0, -1)
    """Seconds of processor time, and the number of the input."""
    memory: int = 0
    """Bytes that the worker grew by at most."""

    def add(self, other: Found) -> None:
        """Count a batch in."""
        self.accepted += other.accepted
        self.refused += other.refused
        self.failures += other.failures
        self.slowest = max(self.slowest, other.slowest)
        self.memory = max(self.memory, other.memory)


def read_one(reader: Reader, content: bytes, folder: Path, at: int, found: Found) -> None:
    """Let a reader read an input, and note what became of it."""
    began = time.process_time()
    try:
        reader.read(content, folder)
        found.accepted += 1
    except StereocalError as error:
        found.refused += 1
        text = str(error)
        if not text or len(text) > LONGEST or not text.isprintable():
            found.failures.append((at, f"no sentence: {text[:600]!r}"))
    except Exception:
        found.failures.append((at, traceback.format_exc()[-3000:]))
    seconds = time.process_time() - began
    found.slowest = max(found.slowest, (seconds, at))
    if seconds > MOST_SECONDS:
        found.failures.append((at, f"{seconds:.1f} s of processor time"))


def work(pipe: Any, now: Any, seed: int) -> None:
    """A worker: batches in, `Found` out. `now` holds the input at hand and when it was begun."""
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", module=r"PIL\.")
    os.environ["STEREOCAL_MOST_MEGAPIXELS"] = MEGAPIXELS
    known = readers()
    with tempfile.TemporaryDirectory() as scratch:
        for reader in known.values():
            for content in reader.seeds():
                read_one(reader, content, Path(scratch), -1, Found())
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + ROOM
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        while (task := pipe.recv()) is not None:
            name, numbers = task
            found = Found()
            for at in numbers:
                content = made(known[name], seed, at)
                now[0], now[1] = at, time.monotonic()
                Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
                before = _memory("VmRSS")
                read_one(known[name], content, Path(scratch), at, found)
                found.memory = max(found.memory, _memory("VmHWM") - before)
            pipe.send(found)


def _memory(key: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key):
            return 1024 * int(line.split()[1])
    return 0


class Worker:
    """A process that reads, and is begun anew when an input ends it."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._begin()

    def _begin(self) -> None:
        # Never fork: the parent has threads.
        context: Any = multiprocessing.get_context("spawn")
        self.now: Any = context.Array("d", [-1.0, 0.0], lock=False)
        self.pipe, other = context.Pipe()
        self.process: Any = context.Process(target=work, args=(other, self.now, self.seed))
        self.process.start()
        other.close()

    def read(self, name: str, numbers: Sequence[int]) -> Found:
        """Read a batch; an input that ends the process or hangs is a failure, the others go on."""
        found, left = Found(), list(numbers)
        while left:
            self.now[0] = -1.0
            self.pipe.send((name, left))
            reason = self._wait()
            if not reason:
                try:
                    found.add(self.pipe.recv())
                    return found
                except (EOFError, OSError):  # what a process that has died leaves can be received
                    reason = self._end_code()
            at = int(self.now[0])
            self.end()
            self._begin()
            found.failures.append((at, reason))
            left = left[left.index(at) + 1 :] if at in left else []
        return found

    def _wait(self) -> str:
        """What ended the process, or nothing."""
        while True:
            try:
                if self.pipe.poll(0.5):
                    return "" if self.process.is_alive() or self.pipe.poll() else self._end_code()
            except (EOFError, OSError):
                return self._end_code()
            if not self.process.is_alive():
                return self._end_code()
            if self.now[0] >= 0 and time.monotonic() - self.now[1] > PATIENCE_S:
                return f"hung for {PATIENCE_S:.0f} s"

    def _end_code(self) -> str:
        self.process.join(5)
        return f"ended the process with code {self.process.exitcode}"

    def end(self) -> None:
        """End it, whatever it does."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def batches(names: Sequence[str], inputs: int) -> Iterator[tuple[str, range]]:
    """About as many inputs for each reader, in batches."""
    each = [inputs // len(names) + (at < inputs % len(names)) for at in range(len(names))]
    for start in range(0, max(each), BATCH):
        for name, count in zip(names, each, strict=True):
            if start < count:
                yield name, range(start, min(start + BATCH, count))


def run(names: Sequence[str], inputs: int, seed: int, workers: int) -> dict[str, Found]:
    """All inputs through all readers."""
    found = {name: Found() for name in names}
    tasks, lock = batches(names, inputs), threading.Lock()

    def drive() -> None:
        worker = Worker(seed)
        while True:
            with lock:
                task = next(tasks, None)
            if task is None:
                worker.end()
                return
            batch = worker.read(*task)
            with lock:
                found[task[0]].add(batch)
                for at, reason in batch.failures:
                    print(f"FAILED {task[0]} {at}: {reason.strip().splitlines()[-1]}", flush=True)

    threads = [threading.Thread(target=drive) for _ in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def report(found: dict[str, Found]) -> None:
    """Print the counts by reader and by group."""
    known = readers()
    print(
        f"{'reader':34}{'inputs':>8}{'accepted':>9}{'refused':>8}{'failed':>7}{'slowest':>9}{'MB':>6}"
    )
    groups: dict[str, Found] = {}
    for name, one in found.items():
        _line(name, one)
        groups.setdefault(known[name].group, Found()).add(one)
    print()
    whole = Found()
    for group, one in sorted(groups.items()):
        _line(group, one)
        whole.add(one)
    _line("all", whole)
    slowest = max(found, key=lambda name: found[name].slowest)
    print(f"slowest: {slowest} {found[slowest].slowest[1]}, {found[slowest].slowest[0]:.2f} s")


def _line(name: str, one: Found) -> None:
    inputs = one.accepted + one.refused + len(one.failures)
    print(
        f"{name:34}{inputs:8}{one.accepted:9}{one.refused:8}{len(one.failures):7}"
        f"{one.slowest[0]:8.2f}s{one.memory / 1e6:6.0f}"
    )


def save(found: dict[str, Found], folder: Path, seed: int) -> None:
    """Keep the inputs that failed, and why."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, one in found.items():
        for at, reason in one.failures:
            stem = f"{name.replace(' ', '_').replace(',', '').replace('/', '_')}-{seed}-{at}"
            (folder / f"{stem}.bin").write_bytes(made(readers()[name], seed, at))
            (folder / f"{stem}.txt").write_text(reason)


def main() -> int:
    """Run from the command line; 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000, help="in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--failures", type=Path, help="folder for the inputs that fail")
    parser.add_argument("--only", help="readers and groups whose names contain this")
    parser.add_argument("--show", nargs=2, metavar=("READER", "NUMBER"), help="write one input")
    parsed = parser.parse_args()
    if parsed.show:
        sys.stdout.buffer.write(made(readers()[parsed.show[0]], parsed.seed, int(parsed.show[1])))
        return 0
    chosen = [
        reader.name
        for reader in readers().values()
        if parsed.only is None or parsed.only in f"{reader.group}: {reader.name}"
    ]
    began, before = time.monotonic(), Counter(chosen)
    found = run(list(before), parsed.inputs, parsed.seed, parsed.workers)
    report(found)
    print(f"{time.monotonic() - began:.0f} s on the wall, seed {parsed.seed}")
    if parsed.failures:
        save(found, parsed.failures, parsed.seed)
    return int(any(one.failures for one in found.values()))


if __name__ == "__main__":
    raise SystemExit(main())
