"""The basic types that everything uses: scales, queries, answers, verdicts, and protocols.

This folder imports from ``_support``.
"""
