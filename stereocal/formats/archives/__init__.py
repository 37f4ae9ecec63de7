"""Data sets from the files of other programs."""
