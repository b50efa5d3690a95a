"""What the project costs and what it finds, measured; each folder says of what. README.md leads to
the results.
"""
