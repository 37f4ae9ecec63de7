"""The world frame: where up is, and the axes that the points are given in."""
