"""JSON made unsound: wrong kinds, lost and doubled keys, extreme values, at any depth."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from random import Random
from typing import Any

from tests.soak.text import NAMES, VALUES, other_number


def changed_json(random: Random, content: bytes, other: bytes) -> bytes:
    """A tree with other values, keys and kinds."""
    tree, another = _loaded(content), _loaded(other)
    if tree is None:
        return other_number(random, content, other)
    for _ in range(random.choice((1, 1, 2, 5))):
        tree = _changed(random, tree, another)
    return dumped(tree, random)


def _loaded(content: bytes) -> Any:
    try:
        return json.loads(content)
    except (ValueError, RecursionError):
        return None


def dumped(tree: Any, random: Random) -> bytes:
    """A tree as text; at times with keys that stand twice."""
    try:
        text = json.dumps(tree, ensure_ascii=random.random() < 0.9)
    except (ValueError, RecursionError):
        text = "[" * 1000
    if random.random() < 0.1:  # a key twice
        text = re.sub(r'("\w+"): ', r"\1: null, \1: ", text, count=random.choice((1, 0)))
    return text.encode("utf-8", "surrogatepass")


def _changed(random: Random, tree: Any, other: Any) -> Any:
    """The tree with one node changed, at any depth."""
    if isinstance(tree, dict | list) and tree and random.random() < 0.85:
        keys: Sequence[Any] = list(tree) if isinstance(tree, dict) else range(len(tree))
        key = random.choice(keys)
        grown: Any = dict(tree) if isinstance(tree, dict) else list(tree)
        grown[key] = _changed(random, tree[key], other)
        return grown
    if isinstance(tree, dict) and tree:
        grown = dict(tree)
        key, act = random.choice(list(tree)), random.randrange(4)
        if act == 0:
            del grown[key]
        elif act == 1:
            grown[random.choice(NAMES)] = grown.pop(key)
        elif act == 2:
            grown[str(random.choice(NAMES))] = random.choice(VALUES)
        else:
            grown[key] = grown[random.choice(list(tree))]
        return grown
    if isinstance(tree, list) and tree and random.random() < 0.7:
        return random.choice(
            (
                tree[:-1],
                tree * 2,
                [*tree, random.choice(VALUES)],
                tree[::-1],
                [tree],
                tree[0],
                tree * random.choice((1, 300)),
                dict(enumerate(map(str, tree))),
            )
        )
    if random.random() < 0.1:
        return other
    if random.random() < 0.05:
        for _ in range(random.choice((5, 500))):
            tree = [tree]
        return tree
    return random.choice(VALUES)


def random_tree(random: Random, depth: int) -> Any:
    """A tree of anything."""
    if depth > 4 or random.random() < 0.4:
        return random.choice(VALUES)
    if random.random() < 0.5:
        return [random_tree(random, depth + 1) for _ in range(random.randrange(4))]
    keys = (
        "format",
        "frames",
        "files",
        "inputs",
        "settings",
        "K",
        "R",
        "T",
        "cameras",
        "pairs",
        *NAMES,
    )
    return {random.choice(keys): random_tree(random, depth + 1) for _ in range(random.randrange(5))}
