"""A contest of ways to ask: each method with its own questions, its own estimate, its own end."""
