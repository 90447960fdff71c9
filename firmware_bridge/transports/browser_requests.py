"""Rules for the requests of browsers that a server accepts.

- Host. A site whose name resolves to this machine (DNS rebinding) has its own name in this header. A server on loopback
  therefore accepts loopback names only.
- Origin. Browsers name the site that a request comes from, always for WebSockets, and no page can change it. Requests
  of other sites are refused. Programs that are not browsers send none.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from firmware_bridge.transports.loopback_host import is_loopback


def refusal(
    hosts: Sequence[str], origins: Sequence[str], *, loopback_only: bool, sites: Collection[str] | None = None
) -> tuple[int, str] | None:
    """Return HTTP status and text for a request that is refused; None: it is accepted.

    `hosts`, `origins`: values of all headers of these names. `sites`: origins of pages that may send requests, in lower
    case, such as "https://example.com"; None: those of the server itself.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return 400, "a request needs one Host header and at most one Origin header"
    host = hosts[0].lower()
    if loopback_only and not is_loopback(_name(host)):
        return 403, "served to this machine only, as localhost or 127.0.0.1"
    if sites is None:
        sites = (f"http://{host}", f"https://{host}")
    if origins and origins[0].lower() not in sites:
        return 403, "no requests from pages of other sites"
    return None


def _name(host: str) -> str:
    """Return the name in 'name:port' or '[::1]:port'."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]
