"""The CUTs that come with the client: `catalog` finds them by name."""
