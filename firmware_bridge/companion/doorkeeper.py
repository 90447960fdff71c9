"""Which keys are let in, asked by ZeroMQ's handshake from a thread of its own (ZAP, RFC 27)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import zmq
from zmq.auth.thread import ThreadAuthenticator

DOMAIN = "companion"


class Doorkeeper:
    """Runs while it is open; started before the first socket that has keys is bound."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], allowed: Mapping[bytes, str]) -> None:
        self._allowed = frozenset(allowed)
        self._authenticator = ThreadAuthenticator(context)
        self._authenticator.start()
        self._authenticator.configure_curve_callback(domain=DOMAIN, credentials_provider=self)

    def callback(self, domain: str, key: bytes) -> bool:
        """Whether the owner of this public key (Z85) may come in."""
        del domain
        return key in self._allowed

    def close(self) -> None:
        with suppress(zmq.ZMQError):
            self._authenticator.stop()
