"""Where an interview is held: a page served on an address, and a widget in a notebook."""
