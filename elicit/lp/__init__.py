"""Linear programs over K_t, the set of scales that fit the answers.

The modules hold regions (K_t as linear constraints), vertices, proofs of a sign, and bounds. They
import from ``model`` and ``_support``.
"""
