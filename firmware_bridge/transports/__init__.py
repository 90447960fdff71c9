"""Bytes and nothing but bytes: serial ports, pseudo-terminals, TCP, UDP, and memory. No message knowledge."""
