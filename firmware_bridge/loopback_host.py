"""Which addresses only this machine can reach. Names are not looked up: only localhost is known."""

from __future__ import annotations

import ipaddress


def is_loopback(host: str) -> bool:
    """Of a name, an address, or an IPv6 address in brackets."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
