"""The mock autopilot without I/O: bytes in, bytes out.

`MockPixhawk.feed(data)` takes what arrived on the wire and returns what the autopilot writes because of it.

`lockstep` (as PX4 SITL): the clock is HIL_SENSOR.time_usec, nothing else: fed the same bytes, however they are cut, it
answers the same bytes. `hitl` (as a real board with SYS_HITL=1): the board has a clock of its own and writes at its own
pace; `feed(b"")` does what is due by now, and `next_due_us` says when to call again. With a clock of simulated time
that is as repeatable.
"""

from __future__ import annotations

from collections.abc import Sequence

from firmware_bridge import _native
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.mock_pixhawk.faults import Fault, Misbehaviour
from firmware_bridge.mock_pixhawk.firmware import Firmware
from firmware_bridge.mock_pixhawk.flight.commander import Commander
from firmware_bridge.mock_pixhawk.flight.navigator import Navigator
from firmware_bridge.mock_pixhawk.hitl import Board, Hitl
from firmware_bridge.mock_pixhawk.ids import COMPONENT_AUTOPILOT
from firmware_bridge.mock_pixhawk.lockstep import Lockstep
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.services.outbox import Outbox
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.mission import MissionItem


class MockPixhawk:
    """One simulated autopilot.

    `airframe` names a file in `airframes/`, `params` are NAME=VALUE strings on top of it (ConfigError if wrong), and
    `sysid`, if given, overrides their MAV_SYS_ID.
    Lockstep only: `boot_sensors` HIL_SENSORs are left unanswered; `offboard_silence`: fall silent, as PX4 does, when
    OFFBOARD is selected while disarmed without set-points.
    With a `board` it runs in HITL, without in lockstep. In HITL SYS_HITL is 1 unless `params` set it, and takes effect
    at boot.
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
        board: Board | None = None,
    ) -> None:
        self._board = board
        self.clock = None if board is None else board.clock  # in lockstep HIL_SENSOR is the clock
        self._boot_sensors, self._offboard_silence = boot_sensors, offboard_silence
        self._misbehaviour = Misbehaviour(tuple(faults))
        self.params = ParamTable(_native_params(), hitl=board is not None)
        self.params.load_airframe(airframe)
        given = [] if sysid is None else [f"MAV_SYS_ID={sysid}"]
        self.params.load([*([] if board is None else ["SYS_HITL=1"]), *params, *given])
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
            hitl=self._board is not None and self.params["SYS_HITL"] == 1,
            host=self,
            mission=mission,
            offboard_silence=self._offboard_silence and self._board is None,
        )
        if self._board is not None:
            self.clocking: Lockstep | Hitl = Hitl(self.firmware, outbox, self._misbehaviour, self._board)
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
        if self.clock is not None:
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
