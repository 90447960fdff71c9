"""The companion of a bench: its clients by name, and the settings of the link to them."""
