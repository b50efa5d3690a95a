"""How real people answer, and how well comparators and laws of error predict them."""
