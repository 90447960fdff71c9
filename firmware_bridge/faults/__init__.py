"""Declared faults of a link, and the transport that applies them."""
