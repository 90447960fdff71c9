"""Declared faults of a wire, and the transport that commits them."""
