"""Linear programs over K_t, the set of scales that fit the answers: regions, vertices, proofs of a
sign, bounds.

Imports from ``model`` and ``_support``.
"""
