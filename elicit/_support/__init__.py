"""Tools that everything uses.

Checks of settings, compiling, work in the background, and hashed random numbers.

Imports nothing of elicit.
"""
