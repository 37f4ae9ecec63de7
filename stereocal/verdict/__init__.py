"""One set or two: the comparison of the sets, and the trade-off of the two costs."""
