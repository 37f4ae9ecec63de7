"""One file per other program whose calibrations are read and written."""
