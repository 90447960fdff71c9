"""Which clients are let in: a hello against the settings, the topics there are, and the clients there are already."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase

from firmware_bridge.codecs.companion import Hello, HelloRefused, schema_hash
from firmware_bridge.companion.clients import Client, Clients
from firmware_bridge.companion.frames import SessionFacts
from firmware_bridge.companion.settings import CompanionSettings

_NAMES = 256  # of clients in a session: what is counted is kept for each of them to the end


class Admission:
    """The rules of one session."""

    def __init__(self, settings: CompanionSettings, facts: SessionFacts, clients: Clients) -> None:
        self._settings, self._clients, self._flown = settings, clients, facts.control
        self.available = dict(facts.topics)
        self.schema = schema_hash(facts.topics)
        self.limit: frozenset[str] | None = None  # of topics, once the run has been planned

    def topics_of(self, patterns: Iterable[str]) -> frozenset[str]:
        """The topics that these patterns name. HelloRefused if one names none, or one that is not to be had."""
        wanted: set[str] = set()
        for pattern in dict.fromkeys(patterns):
            named = [topic for topic in self.available if fnmatchcase(topic, pattern)]
            if not named:
                raise HelloRefused(
                    "topic", f"no topic fits {pattern!r}; there are: {', '.join(sorted(self.available)) or 'none'}"
                )
            wanted.update(named)
        if self.limit is not None and not wanted <= self.limit:
            raise HelloRefused(
                "topic",
                f"{', '.join(sorted(wanted - self.limit))}: not computed in this run, which has been planned without; "
                f"there are: {', '.join(sorted(self.limit)) or 'none'}",
            )
        return frozenset(wanted)

    def check(self, hello: Hello, identity: bytes) -> frozenset[str]:
        """The topics of a client that says hello. HelloRefused saying why it cannot come in."""
        if hello.schema is not None and hello.schema != self.schema:
            raise HelloRefused(
                "schema", f"schema {hello.schema}; this bench's is {self.schema}: its topics or fields are others"
            )
        topics = self.topics_of(hello.topics)
        others = [c for c in self._clients.by_name.values() if c.identity != identity]
        if any(c.name == hello.name for c in others):
            raise HelloRefused("name", f"a client named {hello.name} is here already; choose another name")
        if hello.name not in self._clients.stats and len(self._clients.stats) >= _NAMES:
            raise HelloRefused("full", f"{_NAMES} names have been here; only they may come back")
        if len(others) >= self._settings.max_clients:
            raise HelloRefused("full", f"there are {len(others)} clients, and no more than that may come")
        if hello.control and not self._flown:
            text = "nothing that clients desire is flown in this run (companion.control is false)"
            raise HelloRefused("control", text)
        if hello.control:
            pilot = next((c.name for c in others if c.control), None)
            if pilot is not None:
                raise HelloRefused("control", f"{pilot} is in control; only one client can be")
        return topics

    def check_port(self, hello: Hello, group: str, user: str, session: str) -> Client:
        """Whose socket on a sensor's port this is. HelloRefused if it is nobody's."""
        client = self._clients.by_name.get(hello.name)
        if client is None or (hello.session is not None and hello.session != session) or client.user != user:
            raise HelloRefused("name", f"no client {hello.name} has been welcomed; say hello on the first port first")
        if group not in client.groups:
            raise HelloRefused("topic", f"{hello.name} wants no topic of {group}")
        if group in client.ports:
            raise HelloRefused("name", f"{hello.name} has a socket on this port already")
        return client
