"""Validates a client's hello against the settings, the available topics and the registered clients."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase

from firmware_bridge.codecs.companion import Hello, HelloRefused, schema_hash
from firmware_bridge.companion.clients import Client, ClientRegistry
from firmware_bridge.companion.frames import SessionFacts
from firmware_bridge.companion.settings import CompanionSettings

_MAX_NAMES = 256  # client names in a session, whose counts are kept until it ends


class HelloValidator:
    """Accepts or refuses the clients of one session."""

    def __init__(self, settings: CompanionSettings, facts: SessionFacts, clients: ClientRegistry) -> None:
        self._settings, self._clients, self._control_allowed = settings, clients, facts.control
        self.available = dict(facts.topics)
        self.schema = schema_hash(facts.topics)
        self.computed_topics: frozenset[str] | None = None  # the topics of this run, once they are known

    def topics_of(self, patterns: Iterable[str]) -> frozenset[str]:
        """Return the topics that match these patterns. HelloRefused if one matches none or is not computed."""
        wanted: set[str] = set()
        for pattern in dict.fromkeys(patterns):
            named = [topic for topic in self.available if fnmatchcase(topic, pattern)]
            if not named:
                raise HelloRefused(
                    "topic", f"no topic matches {pattern!r}; available: {', '.join(sorted(self.available)) or 'none'}"
                )
            wanted.update(named)
        if self.computed_topics is not None and not wanted <= self.computed_topics:
            raise HelloRefused(
                "topic",
                f"{', '.join(sorted(wanted - self.computed_topics))}: not computed in this run: no client had "
                f"subscribed to it at its start; computed: {', '.join(sorted(self.computed_topics)) or 'none'}",
            )
        return frozenset(wanted)

    def check(self, hello: Hello, identity: bytes) -> frozenset[str]:
        """Return the topics of a client from its hello. HelloRefused with the reason if it cannot join."""
        if hello.schema is not None and hello.schema != self.schema:
            raise HelloRefused(
                "schema", f"schema {hello.schema} is not the bench's, {self.schema}: topics or fields differ"
            )
        topics = self.topics_of(hello.topics)
        others = [c for c in self._clients.by_name.values() if c.identity != identity]
        if any(c.name == hello.name for c in others):
            raise HelloRefused("name", f"a client named {hello.name} is connected already; choose another name")
        if hello.name not in self._clients.stats and len(self._clients.stats) >= _MAX_NAMES:
            raise HelloRefused("full", f"{_MAX_NAMES} names have been used in this session; only they may join again")
        if len(others) >= self._settings.max_clients:
            raise HelloRefused("full", f"{len(others)} clients are connected, the most that the bench accepts")
        if hello.control and not self._control_allowed:
            text = "no client can control the vehicle in this run (companion.control is false)"
            raise HelloRefused("control", text)
        if hello.control:
            pilot = next((c.name for c in others if c.control), None)
            if pilot is not None:
                raise HelloRefused("control", f"{pilot} is in control; only one client can be")
        return topics

    def check_port(self, hello: Hello, group: str, user: str, session: str) -> Client:
        """Return the client that opens this connection to a sensor's port. HelloRefused if it may not."""
        client = self._clients.by_name.get(hello.name)
        if client is None or (hello.session is not None and hello.session != session) or client.user != user:
            raise HelloRefused("name", f"no client {hello.name} has joined; send a hello to the main port first")
        if group not in client.groups:
            raise HelloRefused("topic", f"{hello.name} has subscribed to no topic of {group}")
        if group in client.ports:
            raise HelloRefused("name", f"{hello.name} has a connection to this port already")
        return client
