"""Side by side with other programs: the same data, the same measure, a file for each."""
