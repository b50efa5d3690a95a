"""Posteriors over a tutor's preferences beside each other: ours and other libraries'."""
