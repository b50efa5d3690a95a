"""Number of questions that a policy costs, and whether certificates hold."""
