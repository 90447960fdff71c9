"""PX4, in SITL and on a board."""
