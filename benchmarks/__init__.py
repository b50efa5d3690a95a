"""Measurements of what the project costs and finds; each folder says of what. README.md leads to
the results.
"""
