"""Runs a CUT against a bench: connects, passes it every frame, sends its answers, reconnects after a loss.

A CUT is a function from a `Frame` to a `Desired` or None, or a callable object with any of: `start(welcome)`, called
before the first frame of every session; `finished`, `report` and `detections`, read after each frame; `view()`, called
at the bench's view period after an answer; `stop()`, called once at the end.
"""

from __future__ import annotations

import math
import sys
import time
import traceback
from dataclasses import dataclass
from typing import Any, Callable, Mapping, Optional

from hil_companion.desired import Desired
from hil_companion.errors import CompanionError, ConnectionLost, CutError, NoBench, OptionError, Refused
from hil_companion.frame import Frame
from hil_companion.link.client import Client
from hil_companion.link.options import DEFAULT_WAIT_S

END_STATUS, OPTION_STATUS, ERROR_STATUS = 0, 2, 3
BACK_OFF_S, BACK_OFF_MAX_S = 0.1, 5.0
DROPPED = "dropped"  # status of an `end` for this client only, which may connect again
# Refusals that are temporary after a loss, because the bench may not have noticed the end of the old connection yet.
_TEMPORARY = ("name", "full", "control")

Cut = Callable[[Frame], Optional[Desired]]


def run(
    cut: Cut,
    address: str,
    *,
    name: str,
    wait_s: float = DEFAULT_WAIT_S,
    reconnect_s: float = math.inf,
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> int:
    """Run until the bench ends and return the exit status: 0 ended, 2 wrong options, 3 error.

    `options`: `topics`, `control` and the other fields of `ClientOptions`. `say` prints one line, by default to stderr.
    """
    say = to_stderr if say is None else say
    runner = Runner(cut, address, {"name": name, **options}, wait_s, reconnect_s, say)
    try:
        runner.run()
        status = END_STATUS
    except KeyboardInterrupt:
        say(f"{name}: stopped after {runner.frames} frames")
        status = END_STATUS
    except OptionError as error:
        say(f"error: {error}")
        status = OPTION_STATUS
    except CompanionError as error:
        say(f"error: {error}")
        status = ERROR_STATUS
    try:
        getattr(cut, "stop", _nothing)()
    except Exception as error:  # noqa: BLE001 (the CUT is the user's code and may raise anything)
        say(f"error: the CUT failed in stop(): {type(error).__name__}: {error}")
        status = status or ERROR_STATUS
    return status


@dataclass
class Runner:
    """Serves one CUT over successive connections to one bench. `options`: of `Client.connect`."""

    _cut: Cut
    _address: str
    _options: dict[str, Any]
    _wait_s: float
    _reconnect_s: float
    _say: Callable[[str], None]
    frames: int = 0
    _session: str | None = None
    _schema: str | None = None

    def run(self) -> None:
        """Serve until the bench ends. Raises CompanionError."""
        client = Client.connect(self._address, wait_s=self._wait_s, **self._options)
        back_off_s = BACK_OFF_S
        while True:
            frames_before = self.frames
            try:
                with client:
                    self._serve(client)
                return
            except ConnectionLost as error:
                if self._reconnect_s <= 0:
                    raise
                self._say(f"{error}; connecting again")
            back_off_s = BACK_OFF_S if self.frames > frames_before else min(2 * back_off_s, BACK_OFF_MAX_S)
            client = self._reconnect(back_off_s)

    def _reconnect(self, back_off_s: float) -> Client:
        deadline_s = time.monotonic() + self._reconnect_s
        while True:
            time.sleep(back_off_s)
            left_s = deadline_s - time.monotonic()
            try:
                return Client.connect(self._address, schema=self._schema, wait_s=max(left_s, 0.1), **self._options)
            except Refused as error:
                if error.code not in _TEMPORARY or left_s <= 0:
                    raise
            except NoBench as error:
                raise ConnectionLost(f"the connection was lost and did not come back: {error}") from error
            back_off_s = min(2 * back_off_s, BACK_OFF_MAX_S)

    def _serve(self, client: Client) -> None:
        welcome = client.welcome
        if welcome.session != self._session:
            self._call(getattr(self._cut, "start", _nothing), welcome)
        self._session, self._schema = welcome.session, welcome.schema
        name = self._options["name"]
        self._say(f"{name}: connected to {self._address} ({welcome.mode}, {welcome.rate_hz:g} Hz)")
        sent_report: dict[str, Any] | None = None  # a new report is sent only if it differs
        show = getattr(self._cut, "view", None) if welcome.views_every_ns > 0 else None
        shown_ns = -welcome.views_every_ns
        for frame in client.frames():
            began_ns = time.monotonic_ns()
            desired = self._call(self._cut, frame)
            t2_ns = time.monotonic_ns() - began_ns
            finished, report = getattr(self._cut, "finished", False), getattr(self._cut, "report", None)
            if callable(finished):
                raise CutError("`finished` of the CUT is a method, which is always true: make it an attribute")
            entries = dict(report) if isinstance(report, Mapping) else None
            changed = report if entries is None or entries != sent_report else None  # no mapping is refused there
            detections = getattr(self._cut, "detections", None)
            client.done(frame, desired, t2_ns=t2_ns, finished=bool(finished), report=changed, detections=detections)
            sent_report = entries
            self.frames += 1
            if show is not None and frame.t_ns - shown_ns >= welcome.views_every_ns:
                shown_ns = frame.t_ns
                view = self._call(show)  # after the answer was sent, so the bench does not wait for it
                if view is not None:
                    client.show(frame, view)
        if client.end is not None and client.end.status == DROPPED:
            raise ConnectionLost(f"{self._address}: dropped by the bench ({client.end.text})")
        if client.end is not None:
            words = f"{client.end.status} {client.end.text}".strip()
            self._say(f"{name}: the bench ended ({words}) after {self.frames} frames")

    @staticmethod
    def _call(function: Any, *arguments: Any) -> Any:
        """Call into the CUT. Any error of its own is printed with its traceback and raised as CutError."""
        try:
            return function(*arguments)
        except CompanionError:
            raise
        except Exception as error:
            traceback.print_exc()
            raise CutError(f"the CUT failed: {type(error).__name__}: {error}") from error


def _nothing(*_: Any) -> None:
    """Stand in for a `start` or `stop` that the CUT does not have."""


def to_stderr(text: str) -> None:
    try:
        sys.stderr.write(text + "\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        pass  # stderr may be closed; the exit status still reports the error
