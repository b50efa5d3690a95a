"""A study: several people answer about one subject, each in a session of their own.

``study`` holds their interviews, and says where each stands and how far they agree. ``report`` is
the page that whoever runs the study keeps.
"""
