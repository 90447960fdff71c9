"""Films of recorded runs."""
