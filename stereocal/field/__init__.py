"""Before and after the field day: plan, print, check, world frame."""
