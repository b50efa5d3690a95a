"""Many runs of learners against tutors: the ablation, its metrics, its picture.

Imports from ``learners`` and below.
"""
