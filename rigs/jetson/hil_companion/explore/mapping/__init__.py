"""Localisation and mapping (SLAM): sweeps, scans, tiled maps and a Rao-Blackwellised particle filter."""
