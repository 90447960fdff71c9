"""The connection to a bench: messages and their checks, sockets, keys, and the client session."""
