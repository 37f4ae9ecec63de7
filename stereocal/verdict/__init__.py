"""Does a rig need one parameter set or two? Comparison of the sets by what they will do."""
