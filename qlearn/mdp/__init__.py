"""MDPs whose rewards are levels: tables, backups, and planning with a known scale.

This folder imports from elicit.
"""
