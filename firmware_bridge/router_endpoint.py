"""Where clients are: one endpoint of the router, and how it is written in a bench file.

udp:HOST:PORT     clients listen on HOST:PORT (QGroundControl 14550, MAVSDK 14540); we send there from a free port
udpin:HOST:PORT   we listen on HOST:PORT and clients come (pymavlink's and MAVSDK's `udpout`)
tcp:HOST:PORT     we listen on HOST:PORT and clients connect (pymavlink's `tcp`, MAVSDK's `tcpout`)
"""

from __future__ import annotations

import re
from typing import NamedTuple

from firmware_bridge.loopback_host import is_loopback

Address = tuple[str, int]

LOOPBACK: Address = ("127.0.0.1", 0)  # port 0: any free one
_FORM = re.compile(r"(udp|udpin|tcp):([A-Za-z0-9._-]+):([0-9]{1,5})")


class Endpoint(NamedTuple):
    """UDP clients that listen on `remote` hear the autopilot, and may talk to it at `local`.

    `remote` None: clients come to `local` by themselves, over UDP or, with `tcp`, over TCP. A `local` host of "" is
    this machine's own address towards `remote`.
    """

    remote: Address | None
    local: Address = LOOPBACK
    tcp: bool = False
    name: str = "client"  # what its clients are called in events: gcs, sdk, companion

    @classmethod
    def parse(cls, text: str, name: str = "client") -> Endpoint:
        """From a bench file's text. ValueError says what it must look like."""
        match = _FORM.fullmatch(text)
        if not match or not 1 <= int(match[3]) <= 65535:
            raise ValueError(
                "must look like udp:127.0.0.1:14550 (clients listen there), udpin:127.0.0.1:14551 or "
                f"tcp:127.0.0.1:5790 (they come to us), not {text!r}"
            )
        address = (match[2], int(match[3]))
        if match[1] == "udp":
            return cls(address, LOOPBACK if is_loopback(address[0]) else ("", 0), name=name)
        return cls(None, address, tcp=match[1] == "tcp", name=name)

    @property
    def is_open_to_others(self) -> bool:
        """Whether anybody on a network may come."""
        return self.remote is None and not is_loopback(self.local[0])


# Where PX4's ground stations (QGroundControl) and SDKs (MAVSDK) listen.
PX4_ENDPOINTS = (
    Endpoint(("127.0.0.1", 14550), name="gcs"),
    Endpoint(("127.0.0.1", 14540), name="sdk"),
)
