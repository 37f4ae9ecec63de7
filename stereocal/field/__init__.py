"""Before and after the field day: a plan of a rig, and what it will measure."""
