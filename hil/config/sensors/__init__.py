"""The sensors of a bench: presets, keys of a bench file merged over them, and noise scaled by the seed."""
