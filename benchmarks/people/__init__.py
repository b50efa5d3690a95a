"""Answers of real people, and how well comparators and laws of error predict them."""
