"""Tools for vehicle files."""
