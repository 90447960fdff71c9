"""An endpoint of the router, and its form in a bench file.

udp:HOST:PORT     clients listen on HOST:PORT (QGroundControl 14550, MAVSDK 14540); the bench sends from a free port
udpin:HOST:PORT   the bench listens on HOST:PORT for datagrams (pymavlink's and MAVSDK's `udpout`)
tcp:HOST:PORT     the bench listens on HOST:PORT for connections (pymavlink's `tcp`, MAVSDK's `tcpout`)
"""

from __future__ import annotations

import re
from typing import NamedTuple

from firmware_bridge.transports.loopback_host import is_loopback

Address = tuple[str, int]

LOOPBACK: Address = ("127.0.0.1", 0)  # port 0: any free one
_FORM = re.compile(r"(udp|udpin|tcp):([A-Za-z0-9._-]+):([0-9]{1,5})")


class Endpoint(NamedTuple):
    """The address that a client listens on (`remote`) and the one that it sends to (`local`).

    `remote` None: clients contact `local` first, over UDP or, with `tcp`, over TCP. A `local` host of "" stands for
    this machine's address on the network of `remote`.
    """

    remote: Address | None
    local: Address = LOOPBACK
    tcp: bool = False
    name: str = "client"  # name of its clients in events: gcs, sdk, companion

    @classmethod
    def parse(cls, text: str, name: str = "client") -> Endpoint:
        """Parse the text of a bench file. ValueError shows the forms that are valid."""
        match = _FORM.fullmatch(text)
        if not match or not 1 <= int(match[3]) <= 65535:
            raise ValueError(
                "must look like udp:127.0.0.1:14550 (clients listen there), udpin:127.0.0.1:14551 or "
                f"tcp:127.0.0.1:5790 (they connect to the bench), not {text!r}"
            )
        address = (match[2], int(match[3]))
        if match[1] == "udp":
            return cls(address, LOOPBACK if is_loopback(address[0]) else ("", 0), name=name)
        return cls(None, address, tcp=match[1] == "tcp", name=name)

    @property
    def is_open_to_others(self) -> bool:
        """True if clients on other machines can connect."""
        return self.remote is None and not is_loopback(self.local[0])


# Where PX4's ground stations (QGroundControl) and SDKs (MAVSDK) listen.
PX4_ENDPOINTS = (
    Endpoint(("127.0.0.1", 14550), name="gcs"),
    Endpoint(("127.0.0.1", 14540), name="sdk"),
)
