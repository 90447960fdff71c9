"""The mock autopilot without I/O: bytes in, bytes out.

`MockPixhawk.feed(data)` takes what arrived on the wire and returns what the autopilot writes because of it.

`lockstep` (as PX4 SITL): the clock is HIL_SENSOR.time_usec, nothing else: fed the same bytes, however they are cut, it
answers the same bytes. `hitl` (as a real board with SYS_HITL=1): the board has a clock of its own and writes at its own
pace; `feed(b"")` does what is due by now, and `next_due_us` says when to call again. With a clock of simulated time
that is as repeatable.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from firmware_bridge import _native
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.mock_pixhawk.commander import Commander
from firmware_bridge.mock_pixhawk.faults import Fault, Misbehaviour
from firmware_bridge.mock_pixhawk.firmware import Firmware
from firmware_bridge.mock_pixhawk.hitl import BoardClock, Hitl
from firmware_bridge.mock_pixhawk.ids import COMPONENT_AUTOPILOT
from firmware_bridge.mock_pixhawk.lockstep import Lockstep
from firmware_bridge.mock_pixhawk.navigator import Navigator
from firmware_bridge.mock_pixhawk.outbox import Outbox
from firmware_bridge.mock_pixhawk.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from hil.signals.mission import MissionItem

DEFAULT_BAUD = 921600
MODES = ("lockstep", "hitl")


class MockPixhawk:
    """One simulated autopilot.

    `airframe` names a file in `airframes/`, `params` are NAME=VALUE strings on top of it (ConfigError if wrong), and
    `sysid`, if given, overrides their MAV_SYS_ID.
    Lockstep only: `boot_sensors` HIL_SENSORs are left unanswered; `offboard_silence`: fall silent, as PX4 does, when
    OFFBOARD is selected while disarmed without set-points.
    HITL only: `clock` is the board's (default: the monotonic wall clock), `baud` the link's rate; on a slow link PX4
    ignores HIL messages. SYS_HITL is 1 unless `params` say otherwise, and takes effect at boot.
    """

    def __init__(
        self,
        *,
        airframe: str = "x500",
        boot_sensors: int = 20,
        sysid: int | None = None,
        params: Sequence[str] = (),
        faults: Sequence[Fault] = (),
        offboard_silence: bool = True,
        mode: Literal["lockstep", "hitl"] = "lockstep",
        clock: BoardClock | None = None,
        baud: int = DEFAULT_BAUD,
    ) -> None:
        if mode not in MODES:
            raise ValueError(f"mode {mode!r}: there are {', '.join(MODES)}")
        self.mode = mode
        self.clock = clock or BoardClock()
        self._boot_sensors, self._offboard_silence, self._baud = boot_sensors, offboard_silence, baud
        self._misbehaviour = Misbehaviour(tuple(faults))
        self.params = ParamTable(_native_params(), hitl=mode == "hitl")
        self.params.load_airframe(airframe)
        given = [] if sysid is None else [f"MAV_SYS_ID={sysid}"]
        self.params.load([*(["SYS_HITL=1"] if mode == "hitl" else []), *params, *given])
        self.boots = 0
        self._power_on([])

    def _power_on(self, mission: list[MissionItem]) -> None:
        """Everything anew but the parameters and the mission, which a board keeps on its card."""
        self.boots += 1
        self._reboot = False
        # Nobody listens to changes before the new software runs.
        self.params.forget_listeners()
        self._parser = FrameParser()
        sysid = int(self.params["MAV_SYS_ID"])
        outbox = self._outbox = Outbox(FrameEncoder(sysid, COMPONENT_AUTOPILOT))
        self.firmware = Firmware(
            params=self.params,
            outbox=outbox,
            sysid=sysid,
            hitl=self.mode == "hitl" and self.params["SYS_HITL"] == 1,
            host=self,
            mission=mission,
            offboard_silence=self._offboard_silence and self.mode == "lockstep",
        )
        if self.mode == "hitl":
            self.clocking: Lockstep | Hitl = Hitl(
                self.firmware, outbox, self._misbehaviour, self.clock, baud=self._baud
            )
        else:
            self.clocking = Lockstep(self.firmware, outbox, self._misbehaviour, self._boot_sensors)
        self._take = self.clocking.take

    # -- the wire -----------------------------------------------------------------------------------------------

    def boot(self) -> bytes:
        """What it writes before it has heard anything."""
        self.clocking.greet()
        return self._outbox.take()

    def feed(self, data: bytes) -> bytes:
        """Take `data` and return what the autopilot writes because of it. Raises `faults.Died` only."""
        out = self._take(self._parser.feed(data))
        return out + self._start_over() if self._reboot else out

    @property
    def next_due_us(self) -> int | None:
        """HITL: when `feed` should be called next, by the board's clock. Lockstep: None."""
        return self.clocking.next_due_us()

    # -- the board, as its software sees it ---------------------------------------------------------------------

    def fall_silent(self) -> None:
        """See `Lockstep.fall_silent`, `Hitl.fall_silent`."""
        self.clocking.fall_silent()

    def request_reboot(self) -> None:
        """MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: start over as soon as what arrived is done with."""
        self._reboot = True
        self.clocking.fall_silent()
        self.clocking.silent = True

    def _start_over(self) -> bytes:
        self.clock.restart()
        self._power_on(self.firmware.missions.items)
        return self.boot()

    # -- for those who look into it -----------------------------------------------------------------------------

    @property
    def vehicle(self) -> Vehicle:
        return self.firmware.vehicle

    @property
    def commander(self) -> Commander:
        return self.firmware.commander

    @property
    def navigator(self) -> Navigator:
        return self.firmware.navigator

    @property
    def silent(self) -> bool:
        """It will not answer any more."""
        return self.clocking.silent

    @property
    def steps(self) -> int:
        """HIL_SENSORs taken."""
        return self.clocking.steps

    @property
    def ignored(self) -> int:
        """Messages that had no effect."""
        return self.clocking.ignored + self.firmware.ignored


def _native_params() -> list[tuple[str, float, float, float]]:
    return list(zip(_native.PARAM_NAMES, _native.PARAM_DEFAULTS, _native.PARAM_MIN, _native.PARAM_MAX, strict=True))
