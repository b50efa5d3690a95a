"""A study: several people answer about the same subject, each in a session of their own.

``study`` holds their interviews, and reports their progress and agreement. ``report`` is the page
that the person who runs the study keeps.
"""
