"""Does a rig need one parameter set or two? Comparison of the sets, trade-off of the two costs."""
