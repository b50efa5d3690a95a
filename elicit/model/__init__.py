"""The words that everything uses: scales, queries, answers, verdicts, and protocols.

Imports from ``_support``.
"""
