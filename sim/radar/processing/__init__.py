"""From the raw samples of an FMCW radar to maps, points and tracks; live in a sensor, or over a recording."""
