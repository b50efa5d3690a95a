"""The command ``qlearn``.

This folder imports from all of qlearn. Each subcommand is imported when it is called.
"""
