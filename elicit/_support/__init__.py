"""Tools that everything uses: checks of settings, compiling, and hashed random numbers.

Imports nothing of elicit.
"""
