"""Cost of keeping a model of an erring tutor, and how often it is wrong."""
