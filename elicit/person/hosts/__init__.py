"""Hosts that show an interview: a page on a web address, and a widget in a notebook."""
