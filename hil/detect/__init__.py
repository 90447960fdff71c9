"""Training and judging a detector on recorded data sets; what runs it lives with the companion's client."""
