"""The router as one of the bench's sources of commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.router import Router


class RouterSource:
    """The router as a source of commands: hands the autopilot's words on, brings the clients' in.

    What is collected goes to the autopilot and is recorded with everything else that does; what clients say only to
    each other is taken by `on_overheard`.
    """

    def __init__(
        self,
        router: Router,
        on_event: Callable[[int, str, str], None] = lambda _t_ns, _kind, _text: None,
        on_overheard: Callable[[int, Sequence[Frame]], None] = lambda _t_ns, _frames: None,
    ) -> None:
        self._router = router
        self._on_event, self._on_overheard = on_event, on_overheard

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        router = self._router
        if frames:
            router.forward(frames)
        data = router.collect(t_ns)
        for kind, text in router.take_events():
            self._on_event(t_ns, kind, text)
        overheard = router.take_overheard()
        if overheard:
            self._on_overheard(t_ns, overheard)
        return data
