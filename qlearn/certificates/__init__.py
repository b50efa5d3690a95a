"""Upper bounds on what a policy can lose, over all plausible scales.

This folder imports from ``mdp`` and elicit.
"""
