"""A Pixhawk in HITL, real or mocked, on a serial line: the ticks of `realtime.link`.

Per tick: [extra], then [range and flow][HIL_GPS if due][HIL_SENSOR id 0], with a TIMESYNC request now and then. A
silent line ends the run. HIL_STATE_QUATERNION is never sent: it overwrites the inputs of PX4's estimator.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil import HIL_ACTUATOR_CONTROLS, actuator_frame
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.links.autopilot_link import InvalidControls, LinkCaps, LinkTimeouts, TickSamples
from firmware_bridge.links.px4.hitl_setup import HitlSetup, await_autopilot
from firmware_bridge.links.px4.lockstep import AirTemperature, tick_messages
from firmware_bridge.links.px4.restart import BoardRestart
from firmware_bridge.links.realtime.link import RealtimeLink
from firmware_bridge.transports.transport import Transport
from signals.errors import HandshakeError, LinkError
from signals.samples import ActuatorFrame
from signals.time import NS_PER_S

_MOST_BAD_IN_A_ROW = 25  # commands that are not numbers: a tenth of a second of them
_TIMEOUTS = LinkTimeouts(reply_s=5.0)


class FreeRunningLink(RealtimeLink):
    """HITL over `transport`.

    With `motors`, a board is checked before the flight: it is restarted if it has flown since its boot, and must be set
    up for so many motors after `params` have been set.
    Other settings as `RealtimeLink`.
    """

    def __init__(
        self,
        transport: Transport,
        caps: LinkCaps,
        *,
        motors: int | None = None,
        params: Mapping[str, float] | None = None,
        timeouts: LinkTimeouts = _TIMEOUTS,
        **settings: Any,
    ) -> None:
        self._transport = transport
        self._motors = motors
        self._params = params
        super().__init__(caps, transport, timeouts=timeouts, **settings)

    def _reset(self) -> None:
        super()._reset()
        self._latest: Frame | None = None
        self._bad_in_a_row = 0
        self._air = AirTemperature() if self._caps.air_temperature else None

    def _await_autopilot(self) -> None:
        line, limit_s = self._transport, self._timeouts.connect_s
        sysid = await_autopilot(
            line,
            self._parser,
            limit_s=limit_s,
            on_frames=self._keep,
            on_delay=lambda text: self._say("waiting", text),
            name=self.name,
        )
        if self._motors is not None:
            setup = HitlSetup(line, self._parser, motors=self._motors, sysid=sysid)
            if self._process is None:  # a program that the bench started has just booted
                BoardRestart(line, setup, self._say, self.name).require_fresh()
            if self._params:
                setup.set(self._params)
            setup.require()

    def _keep(self, frames: list[Frame]) -> None:
        """Keep frames that come before the run begins."""
        self._frames += frames
        self._check_process("ended before its first heartbeat")

    def _command(self, tick: int) -> ActuatorFrame | None:
        """Return the newest command, once. InvalidControls if many commands in a row are not numbers.

        A single such command is counted and skipped: about one damaged message in 65536 has a good checksum.
        """
        latest, self._latest = self._latest, None
        if latest is None:
            return None
        try:
            frame = actuator_frame(tick, latest)
        except CodecError as error:
            self._stats.bad_controls += 1
            self._bad_in_a_row += 1
            if self._bad_in_a_row > _MOST_BAD_IN_A_ROW:
                text = (
                    f"tick {tick}: {error}, and so were the {_MOST_BAD_IN_A_ROW} commands before; check the line, and "
                    "the autopilot's mixer and estimator"
                )
                raise InvalidControls(self.name, text) from error
            return None
        self._bad_in_a_row = 0
        return frame

    def send(self, tick: int, t_ns: int, samples: TickSamples, extra: bytes) -> bytes:  # noqa: ARG002
        """Pass the tick's bytes to the sender and return them. CodecError if a sample is not a number."""
        stats = self._stats
        request = self.timesync.request(self._deadline_ns)
        if self._air is not None:
            samples = self._air.put(samples)
        data = tick_messages(self._encoder, t_ns, samples, request=request)
        # Commands must arrive; a stale sample is dropped rather than sent late.
        if extra:
            self._push(extra, keep=True)
        self._push(data, keep=False)
        stats.steps += 1
        data = extra + data
        stats.tx_bytes += len(data)
        return data

    def _take(self, transport: Transport, data: bytes) -> None:  # noqa: ARG002 (there is one)
        self._take_mavlink(data)

    def _take_frame(self, frame: Frame, now_ns: int) -> bool:  # noqa: ARG002
        if frame[0] != HIL_ACTUATOR_CONTROLS:
            return False
        self._latest = frame
        return True

    def _check_silence(self, now_ns: int) -> None:
        silent_ns = now_ns - self._received_ns
        if silent_ns > self._silence_limit_ns:
            said = f"no message has come for {silent_ns / NS_PER_S:.1f} s"
            if self._process is not None:
                said += "; its process still runs" if self._process.running() else f"; {self._process.describe_end()}"
            raise LinkError(self.name, f"{said}. Is it hung, or was the flight terminated? Restart it", cause="silent")
        if self._still_hears(now_ns) and now_ns - self._commanded_ns > self._silence_limit_ns:
            raise HandshakeError(
                self.name,
                f"messages come, but no HIL_ACTUATOR_CONTROLS for {self._silence_limit_ns / NS_PER_S:g} s: is "
                "SYS_HITL 1 since its last boot, and the line's data rate above 5000 bytes/s (57600 baud is not)? "
                "Check with `hil devices --check PORT`",
                cause="no_controls",
            )
