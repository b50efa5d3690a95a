"""Linear programs over K_t, the set of scales that fit the answers.

The modules hold regions, vertices, proofs of a sign, and bounds. They import from ``model`` and
``_support``.
"""
