"""MDPs whose rewards are levels, and their ground truth: tables, backups, planning. Imports from
elicit.
"""
