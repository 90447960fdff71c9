"""Generators of the art that does not depend on a run: models and textures of sim/scene/assets.

`python -m tools.art` makes every file again, byte for byte. The wheel holds the files and not the generators.
"""
