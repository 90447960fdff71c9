"""UDP ports of the participants of a DDS domain on one machine (DDSI-RTPS 2.5, 9.6.2.3)."""

from __future__ import annotations

import socket
from collections.abc import Iterable

MAX_PARTICIPANTS = 32  # of one machine and domain, each with ports of its own


def free_domain(domains: Iterable[int]) -> int | None:
    """Return the first of these domains whose first port is free on all addresses; None: there is none."""
    everywhere = "0.0.0.0"  # noqa: S104 (nothing is received: the port is closed again at once)
    return next((domain for domain in domains if _is_free(everywhere, _port(domain, 0))), None)


def has_free_port(domain: int) -> bool:
    """Return True if one of the ports of a domain's participants is free on the loopback interface."""
    return any(_is_free("127.0.0.1", _port(domain, index)) for index in range(MAX_PARTICIPANTS))


def _port(domain: int, participant: int) -> int:
    return 7410 + 250 * domain + 2 * participant


def _is_free(address: str, port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, port))
        except OSError:
            return False
        return True
