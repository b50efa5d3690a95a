"""Cost of learning, beside the same loops that know the values."""
