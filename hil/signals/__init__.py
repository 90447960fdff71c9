"""Leaf package: sample types, time, frames, noise streams, errors. Imports the standard library and numpy only."""
