"""Projects on disk: one SQLite file each, `<home>/projects/<id>.sqlite`."""
