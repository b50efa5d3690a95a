"""Today's code beside older code of the project, on the same data."""
