"""Transports: bytes over serial ports, pseudo-terminals, TCP, UDP or memory, without knowledge of messages."""
