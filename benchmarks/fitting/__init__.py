"""What a model of an erring tutor costs to keep, and how often it is wrong."""
