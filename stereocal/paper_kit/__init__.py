"""What a paper needs of a result: methods paragraph, figures, table, and an archive to rerun."""
