"""Measurements of what the paper leaves open, of exploration, and the rows behind notebook 04."""
