"""Upper bounds on what a policy can lose, over all plausible scales. Imports from ``mdp`` and
elicit.
"""
