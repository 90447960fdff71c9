"""Objects that are moved, added and taken out of a world while it is used."""
