"""Flight logs of any format as series in the bench's frames, and the flights in them."""
