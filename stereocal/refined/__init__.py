"""Method 4 (`stereocal.refined.refine`), and the screening that is based on it."""
