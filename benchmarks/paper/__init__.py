"""What the paper leaves open, how to explore, and the rows behind notebook 04."""
