"""Method 4 (`stereocal.refined.refine`), and the screening and diagnosis that are based on it."""
