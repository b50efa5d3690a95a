"""Many runs of learners against tutors: the ablation, its metrics, its picture.

This folder imports from ``learners`` and below.
"""
