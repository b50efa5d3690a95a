"""How many questions a policy costs, and whether certificates hold."""
