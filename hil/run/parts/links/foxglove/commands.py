"""Commands of Foxglove's clients: parameters, services and playback control.

The SDK calls the methods of `Commands` in threads of its own. They check what can be checked at once and put the
command into a queue; the run carries it out before its next tick (`hil.run.loop.by_hand`). A service answers when its
command has been carried out.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from reprlib import repr as shortened
from typing import Any

from hil.run.loop.by_hand import PACE_LIMITS, WIND_LIMIT_MPS, HandControl, HandledVehicle, Refused
from hil.run.parts.links.foxglove.server import LiveServer
from signals.samples import Vec3

PACE, PAUSED, STEADY, TURBULENCE = "pace", "paused", "wind.steady_mps", "wind.turbulence_mps"
_ANSWER_S = 10.0  # a service's command that was not carried out by then has failed
_MAX_QUEUED = 1000


class Command:
    """A command on its way from a client to the run."""

    def __init__(self, kind: str, message: Mapping[str, Any]) -> None:
        self.kind, self.message = kind, message
        self.done = threading.Event()
        self.refusal = ""
        self.tick = 0


class Commands:
    """Takes commands of clients. Listener of the SDK's server, and the queue to the run."""

    def __init__(self, server: LiveServer) -> None:
        self._server = server
        self._queue: deque[Command] = deque()
        self.wake = threading.Event()  # set when a command arrives
        self.subscribed: deque[str] = deque()  # topics that got a subscriber
        self._values: dict[str, Any] = {PACE: 0.0, PAUSED: False, STEADY: [0.0, 0.0, 0.0], TURBULENCE: 0.0}
        self._closed = False
        self.playback_speed = 1.0
        self._t_ns = 0  # simulated time as told last

    # -- by the run -------------------------------------------------------------------------------------------------

    @property
    def waiting(self) -> bool:
        return bool(self._queue)

    def carry_out(self, control: HandControl, vehicles: Mapping[str, HandledVehicle], steady_W_mps: Vec3) -> None:
        """Carry out what has arrived."""
        while self._queue:
            command = self._queue.popleft()
            name = command.message.get("vehicle", "")
            vehicle = vehicles.get(name) if isinstance(name, str) else None
            first = next(iter(vehicles.values()))
            try:
                if vehicle is None and name:
                    raise Refused(f"{command.kind}: no vehicle of this run is named {shortened(name)}")
                message = dict(command.message)
                if command.kind == "wind":  # the wind by hand is on top of the bench's
                    wanted = message["velocity_W_mps"]
                    message["velocity_W_mps"] = [w - s for w, s in zip(wanted, steady_W_mps, strict=True)]
                control.carry_out(command.kind, message, vehicle or first)
            except Refused as refusal:
                command.refusal = str(refusal)
                self._server.status(f"refused: {refusal}", level="Error")
            command.tick = control.serving.access.scheduler.tick
            command.done.set()

    def show(self, values: Mapping[str, Any]) -> None:
        """Set the parameters' values, and let the clients get them if one has changed."""
        if any(self._values[name] != value for name, value in values.items()):
            self._values.update(values)
            self._server.parameters_changed()

    def close(self) -> None:
        """Refuse whatever still waits: the run is over."""
        self._closed = True
        while self._queue:
            command = self._queue.popleft()
            command.refusal = "the run is over"
            command.done.set()

    # -- by the SDK's threads ---------------------------------------------------------------------------------------

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
        self.subscribed.append(channel.topic)
        self.wake.set()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing: the server asks the channels for their subscribers."""

    def on_parameters_subscribe(self, names: Sequence[str]) -> None:
        """Do nothing: the SDK sends `show`'s values to the subscribers."""

    def on_parameters_unsubscribe(self, names: Sequence[str]) -> None:
        """Do nothing, likewise."""

    def on_get_parameters(self, client: Any, names: Sequence[str], request_id: str | None = None) -> list[Any]:  # noqa: ARG002
        """Return the parameters of these names; of none: all."""
        return self._parameters({name: self._values[name] for name in names or self._values if name in self._values})

    def on_set_parameters(self, client: Any, parameters: Sequence[Any], request_id: str | None = None) -> list[Any]:  # noqa: ARG002
        """Check the values and queue them. Return all parameters: with the new values, or unchanged where refused.

        The SDK sends them to the clients that subscribed to parameters.
        """
        for parameter in parameters:
            try:
                kind, message, value = _parameter_command(parameter.name, parameter.get_value())
                self._put(Command(kind, message))
                self._values[parameter.name] = value  # `show` sets it right if the run refuses it
            except Refused as refusal:
                self._server.status(f"refused: {refusal}", level="Error")
        return self._parameters(self._values)

    def on_playback_control_request(self, request: Any) -> Any:
        """Pause or resume the run, or change its pace. A flight has no way back, so a seek is refused."""
        websocket = self._server.sdk.websocket
        play = request.playback_command == websocket.PlaybackCommand.Play
        if request.seek_time is not None:
            self._server.status("refused: seek: a flight goes on only", level="Warning")
        speed = float(request.playback_speed)
        try:
            if speed != self.playback_speed:  # Play repeats the speed that it was told
                kind, message, _ = _parameter_command(PACE, speed)
                self._put(Command(kind, message))
                self.playback_speed = speed
            self._put(Command("resume" if play else "pause", {}))
        except Refused as refusal:
            self._server.status(f"refused: {refusal}", level="Error")
        return self.playback_state(paused=not play, request_id=request.request_id)

    def playback_state(
        self, *, paused: bool, t_ns: int | None = None, ended: bool = False, request_id: str | None = None
    ) -> Any:
        """Return the state of the run in the terms of playback control. `t_ns` None: as told last."""
        websocket = self._server.sdk.websocket
        if t_ns is not None:
            self._t_ns = t_ns
        states = websocket.PlaybackStatus
        status = states.Ended if ended else states.Paused if paused else states.Playing
        return websocket.PlaybackState(status, self._t_ns, self.playback_speed, False, request_id)

    def services(self) -> list[Any]:
        """Return the services, which take and return JSON."""
        fault = {"description": "A fault as in the section `faults` of a bench; see docs/foxglove.md."}
        return [
            self._service("/hil/pause", "pause", {}),
            self._service("/hil/resume", "resume", {}),
            self._service("/hil/step", "step", {}),
            self._service("/hil/inject", "inject", fault),
        ]

    def _service(self, name: str, kind: str, request: Mapping[str, Any]) -> Any:
        sdk = self._server.sdk

        def schema(title: str, extra: Mapping[str, Any]) -> Any:
            text = json.dumps({"type": "object", "title": title, **extra})
            return sdk.MessageSchema(
                encoding="json", schema=sdk.Schema(name=title, encoding="jsonschema", data=text.encode())
            )

        answer = {"properties": {"tick": {"type": "integer"}}}
        title = name.removeprefix("/").replace("/", "_")
        return sdk.Service(
            name,
            schema=sdk.ServiceSchema(
                title, request=schema(f"{title}_request", request), response=schema(f"{title}_response", answer)
            ),
            handler=lambda call: self._serve(kind, call.payload),
        )

    def _serve(self, kind: str, payload: bytes) -> bytes:
        """Carry out a service call. Raises ValueError, which the client gets as the call's failure."""
        try:
            request = json.loads(payload or b"{}")
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{kind}: the request is not JSON: {error}") from None
        if not isinstance(request, dict):
            raise ValueError(f"{kind}: the request must be a JSON object")
        message: dict[str, Any] = {"vehicle": request.pop("vehicle", "")}
        if kind == "inject":
            message["fault"] = request
        elif request:
            raise ValueError(f"{kind}: takes no {', '.join(request)}")
        command = Command(kind, message)
        self._put(command)
        if not command.done.wait(_ANSWER_S):
            raise ValueError(f"{kind}: the run has not come to its next tick within {_ANSWER_S:g} s")
        if command.refusal:
            raise ValueError(command.refusal)
        return json.dumps({"tick": command.tick}).encode()

    def _put(self, command: Command) -> None:
        if self._closed:
            raise Refused("the run is over")
        if len(self._queue) >= _MAX_QUEUED:
            raise Refused(f"{command.kind}: {_MAX_QUEUED} commands are waiting already")
        self._queue.append(command)
        self.wake.set()

    def _parameters(self, values: Mapping[str, Any]) -> list[Any]:
        return [self._server.sdk.Parameter(name, value=value) for name, value in values.items()]


def _parameter_command(name: str, value: Any) -> tuple[str, dict[str, Any], Any]:
    """Return kind and message of the command that sets a parameter, and the value as shown. Raises Refused."""
    if name == PAUSED:
        if not isinstance(value, bool):
            raise Refused(f"{name} must be true or false, not {shortened(value)}")
        return ("pause" if value else "resume"), {}, value
    if name == PACE:
        pace = _number(name, value, 0.0, PACE_LIMITS[1], "times real time; 0: as fast as it goes")
        if 0.0 < pace < PACE_LIMITS[0]:
            raise Refused(f"{name} must be at least {PACE_LIMITS[0]:g} times real time, or 0: as fast as it goes")
        return "pace", {"pace": pace or None}, pace
    if name == STEADY:
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise Refused(f"{name} must be three numbers (east, north, up) [m/s], not {shortened(value)}")
        limit = WIND_LIMIT_MPS
        velocity = [_number(name, v, -limit, limit, "m/s") for v in value]
        return "wind", {"velocity_W_mps": velocity}, velocity
    if name == TURBULENCE:
        strength = _number(name, value, 0.0, WIND_LIMIT_MPS, "m/s of wind at 20 ft")
        return "turbulence", {"wind_20ft_mps": strength}, strength
    raise Refused(f"there is no parameter {shortened(name)}")


def _number(name: str, value: Any, least: float, most: float, unit: str) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not least <= value <= most:  # also NaN
        raise Refused(f"{name} must be from {least:g} to {most:g} {unit}, not {shortened(value)}")
    return float(value)
