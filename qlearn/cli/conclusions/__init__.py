"""Conclusions of ``qlearn teach``: a policy or a choice, in words and tables."""
