"""Number of questions and trainings that a policy from any trainer costs, bounds, and wrappers."""
