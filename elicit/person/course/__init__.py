"""The course of an interview.

How the person answers, what is asked once the asker is done, and what is concluded.
"""
