"""Satellite navigation in a scene: the satellites that an antenna sees, their signals, and the fix from them."""
