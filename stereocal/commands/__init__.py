"""One file per command: `OPTIONS` are its options, `run` does it."""
