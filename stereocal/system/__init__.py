"""The ground: settings from the environment, atomic files, tasks on executors, decoding."""
