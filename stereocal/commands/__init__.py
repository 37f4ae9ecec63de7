"""One file per command: `add` says its options, `run` does it."""
