"""The course of an interview: the person's conduct, further questions, and the conclusion."""
