"""A real flight, flown again: its set-points on the bench's clock and in W, and how the two flights differ."""
