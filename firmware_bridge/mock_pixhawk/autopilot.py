"""The mock autopilot without I/O: bytes in, bytes out.

`MockPixhawk.feed(data)` takes received bytes and returns the bytes that the autopilot writes.

`lockstep` (as PX4 SITL): the only clock is HIL_SENSOR.time_usec. The same input gives the same output, however it is
cut into reads. `hitl` (as a real board with SYS_HITL=1): the board has its own clock and writes at its own times;
`feed(b"")` runs what is due now, and `next_due_us` says when to call again. With simulated time as its clock it is
deterministic too.
"""

from __future__ import annotations

from collections.abc import Sequence

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.mock_pixhawk.faults import Fault, FaultInjector
from firmware_bridge.mock_pixhawk.firmware import Firmware
from firmware_bridge.mock_pixhawk.flight.commander import Commander
from firmware_bridge.mock_pixhawk.flight.mission_runner import MissionRunner
from firmware_bridge.mock_pixhawk.hitl import Board, Hitl
from firmware_bridge.mock_pixhawk.ids import COMPONENT_AUTOPILOT
from firmware_bridge.mock_pixhawk.lockstep import Lockstep
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable, airframe_kind
from firmware_bridge.mock_pixhawk.services.outbox import Outbox
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.mission import MissionItem


class MockPixhawk:
    """One simulated autopilot.

    `airframe` names a file in `airframes/`, `params` are NAME=VALUE strings on top of it (ConfigError if wrong), and
    `sysid`, if given, overrides their MAV_SYS_ID.
    Lockstep only: the first `boot_sensors` HIL_SENSORs get no reply; with `offboard_silence` the mock falls silent,
    as PX4 does, when OFFBOARD is selected while disarmed without set-points.
    With a `board` it runs in HITL, else in lockstep. In HITL, SYS_HITL is 1 unless `params` sets it; it takes effect at
    boot.
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
        self._fault_injector = FaultInjector(tuple(faults))
        kind = airframe_kind(airframe)
        self.params = ParamTable.of_firmware(hitl=board is not None, plane=kind != "multirotor", vtol=kind == "VTOL")
        self.params.load_airframe(airframe)
        given = [] if sysid is None else [f"MAV_SYS_ID={sysid}"]
        self.params.load([*([] if board is None else ["SYS_HITL=1"]), *params, *given])
        self.boots = 0
        self._power_on([])

    def _power_on(self, mission: list[MissionItem]) -> None:
        """Boot. Parameters and mission are kept, as on a board's SD card."""
        self.boots += 1
        self._reboot = False
        # The callbacks of the firmware before the reboot.
        self.params.clear_callbacks()
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
            self.timing: Lockstep | Hitl = Hitl(self.firmware, outbox, self._fault_injector, self._board)
        else:
            self.timing = Lockstep(self.firmware, outbox, self._fault_injector, self._boot_sensors)
        self._take = self.timing.take

    # -- the wire -----------------------------------------------------------------------------------------------

    def boot(self) -> bytes:
        """Return what the autopilot writes before it has received anything."""
        self.timing.send_boot_messages()
        return self._outbox.take()

    def feed(self, data: bytes) -> bytes:
        """Take `data` and return what the autopilot writes in reply. Raises only `faults.Died`."""
        out = self._take(self._parser.feed(data))
        return out + self._restart() if self._reboot else out

    @property
    def next_due_us(self) -> int | None:
        """HITL: time of the next call of `feed`, by the board's clock. Lockstep: None."""
        return self.timing.next_due_us()

    # -- functions of the board ----------------------------------------------------------------------------------

    def fall_silent(self) -> None:
        """Stop answering, see `Lockstep.fall_silent` and `Hitl.fall_silent`."""
        self.timing.fall_silent()

    def request_reboot(self) -> None:
        """Reboot (MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN) after the received data are handled."""
        self._reboot = True
        self.timing.fall_silent()
        self.timing.silent = True

    def _restart(self) -> bytes:
        if self.clock is not None:
            self.clock.restart()
        self._power_on(self.firmware.missions.items)
        return self.boot()

    # -- state, for tests and the process -----------------------------------------------------------------------

    @property
    def vehicle(self) -> Vehicle:
        return self.firmware.vehicle

    @property
    def commander(self) -> Commander:
        return self.firmware.commander

    @property
    def navigator(self) -> MissionRunner:
        return self.firmware.navigator

    @property
    def silent(self) -> bool:
        """True once the autopilot does not answer any more."""
        return self.timing.silent

    @property
    def steps(self) -> int:
        """Number of HIL_SENSORs taken."""
        return self.timing.steps

    @property
    def ignored(self) -> int:
        """Number of messages without effect."""
        return self.timing.ignored + self.firmware.ignored
