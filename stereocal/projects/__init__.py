"""Pieces of work on disk: a project is one SQLite file, `<home>/projects/<id>.sqlite`."""
