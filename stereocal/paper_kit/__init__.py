"""What a paper needs of a result: methods text, references, table, data set, parameter files."""
