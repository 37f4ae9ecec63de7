"""A recording in, all results out: what commands, pages and scripts call."""
