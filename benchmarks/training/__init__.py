"""How few questions and trainings a policy from any trainer costs, whether bounds are kept, and
what wrappers cost.
"""
