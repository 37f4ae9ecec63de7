"""The studies of a benchmark, run by name: `python -m benchmarks.NAME [STUDY ...] [--trials N]`."""

import argparse
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.stats import beta


def run_studies(
    studies: Mapping[str, tuple[Callable[[int], None], int]], about: str | None
) -> None:
    """Run the studies named on the command line, or all.

    Args:
        studies: by name, what runs a number of trials, and the usual number.
        about: what the studies are.
    """
    parser = parser_of(about)
    parser.add_argument("studies", nargs="*", choices=[*studies, []], default=[], metavar="STUDY")
    parser.add_argument("--trials", "--rigs", type=int, help="rigs, or other trials, of each")
    parsed = parser.parse_args()
    for name in parsed.studies or studies:
        study, usual = studies[name]
        trials, begun = parsed.trials or usual, time.process_time()
        print(f"{name}, {trials} trials:")
        study(trials)
        print(f"  {name}: {time.process_time() - begun:.0f} s of CPU time", flush=True)


def numbers_asked(about: str | None, **usual: Any) -> argparse.Namespace:
    """What `--NAME` says on the command line, one value or several as the usual ones are."""
    parser = parser_of(about)
    for name, value in usual.items():
        several, kind = isinstance(value, list), type(np.ravel(value)[0].item())
        parser.add_argument(f"--{name}", type=kind, nargs="+" if several else None, default=value)
    return parser.parse_args()


def parser_of(about: str | None) -> argparse.ArgumentParser:
    """A parser that shows what the studies are as it is written."""
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(description=about, formatter_class=formatter)


def exact_interval(found: int, of: int) -> str:
    """A share with its exact 95 % binomial interval, in per cent."""
    low = beta.ppf(0.025, found, of - found + 1) if found else 0.0
    high = beta.ppf(0.975, found + 1, of - found) if found < of else 1.0
    return f"{100 * found / of:.2f} % ({100 * low:.2f} to {100 * high:.2f})"
