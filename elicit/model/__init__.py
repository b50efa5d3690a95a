"""The words everything speaks in: scales, queries, answers, verdicts, and the Comparator protocol.

Imports from ``_support``.
"""
