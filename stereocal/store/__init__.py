"""What a server keeps on disk beside `stereocal.project`."""
