"""What the vehicle says in words."""

from __future__ import annotations

from typing import Any

_LIMIT = 1000  # a vehicle that complains without end must not fill the memory


class StatusTexts:
    """STATUSTEXT messages as (t_ns, severity, text), long ones joined from their chunks."""

    def __init__(self) -> None:
        self.texts: list[tuple[int, int, str]] = []
        self._chunk_id = 0
        self._chunk_next = 0

    def on_statustext(self, t_ns: int, message: Any) -> None:
        if message.chunk_seq and message.id == self._chunk_id and message.chunk_seq == self._chunk_next and self.texts:
            first_ns, severity, text = self.texts[-1]
            self.texts[-1] = (first_ns, severity, text + message.text)
        elif len(self.texts) < _LIMIT:
            self.texts.append((t_ns, message.severity, message.text))
        self._chunk_id, self._chunk_next = message.id, message.chunk_seq + 1

    def last(self, count: int = 3) -> str:
        """The latest texts that differ, for an error message; "" if there are none."""
        latest = list(dict.fromkeys(text.strip() for _, _, text in reversed(self.texts)))[:count]
        return f"; it last said: {' | '.join(reversed(latest))}" if latest else ""
