"""What the rest stands on: checks of settings, compiling, and hashed random numbers. Imports
nothing of elicit.
"""
