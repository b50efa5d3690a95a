"""What learning costs beside the same loops that know the values."""
