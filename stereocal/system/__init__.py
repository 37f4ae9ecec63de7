"""Settings from the environment, atomic files, tasks on executors, decoding untrusted files."""
