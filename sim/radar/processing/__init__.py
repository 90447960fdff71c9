"""Processing of an FMCW radar's raw samples to maps, points and tracks, in a sensor or over a recording."""
