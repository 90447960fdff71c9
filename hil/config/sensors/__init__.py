"""The sensors of a bench: presets, the keys of a file over them, and the noise that a seed gives them."""
