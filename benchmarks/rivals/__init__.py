"""Checks of the contest's rewritten rivals against figures that others print."""
