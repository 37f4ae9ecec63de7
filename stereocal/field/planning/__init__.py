"""A plan of a field day, and what its rig will measure."""
