"""The shipped CUTs; `catalog` finds them by name."""
