"""UDP ports of the participants of a DDS domain on one machine (DDSI-RTPS 2.5, 9.6.2.3)."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable, Iterator
from contextlib import suppress

_FIRST_PORT, _PORTS = 7400, 250  # of domain 0, of each domain
MAX_PARTICIPANTS = 32  # of one machine and domain, each with ports of its own


def free_domain(domains: Iterable[int]) -> int | None:
    """Return the first of these domains whose first port is free on all addresses; None: there is none."""
    everywhere = "0.0.0.0"  # noqa: S104 (nothing is received: the port is closed again at once)
    return next((domain for domain in domains if _is_free(everywhere, _port(domain, 0))), None)


def has_free_port(domain: int) -> bool:
    """Return True if one of the ports of a domain's participants is free on the loopback interface."""
    return any(_is_free("127.0.0.1", _port(domain, index)) for index in range(MAX_PARTICIPANTS))


def receive_on(interface: str, domain: int) -> None:
    """Let this process' sockets of a domain receive from one interface alone, whatever address they are bound to.

    CycloneDDS binds the sockets that receive to all addresses. Raises OSError where the system does not allow it, as
    Linux before 5.7 without CAP_NET_RAW.
    """
    for each in own_sockets(domain):
        with each:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())


def own_sockets(domain: int) -> Iterator[socket.socket]:
    """Return copies of this process' UDP sockets at the ports of a domain; close them."""
    first = _FIRST_PORT + _PORTS * domain
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed since
            descriptor = os.dup(int(name))
            try:
                copy = socket.socket(fileno=descriptor)
            except OSError:  # no socket
                os.close(descriptor)
                continue
            is_internet = copy.family in (socket.AF_INET, socket.AF_INET6) and copy.type == socket.SOCK_DGRAM
            if is_internet and first <= copy.getsockname()[1] < first + _PORTS:
                yield copy
            else:
                copy.close()


def _port(domain: int, participant: int) -> int:
    return _FIRST_PORT + 10 + _PORTS * domain + 2 * participant


def _is_free(address: str, port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, port))
        except OSError:
            return False
        return True
