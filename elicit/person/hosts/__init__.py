"""Hosts of an interview: a page served on an address, and a widget in a notebook."""
