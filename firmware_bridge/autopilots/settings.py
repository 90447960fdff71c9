"""The section `autopilot` of a bench file. Which keys mean something to which kind is in the kinds' profiles."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator

from signals.documents.validate import Section

ENV_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
FaultTime = Annotated[float, Field(ge=0)] | None


class MockFaults(Section):
    """Faults of the mock Pixhawk itself, each from a simulated time on; null: never."""

    die_at_s: FaultTime = None  # its process ends
    stall_at_s: FaultTime = None  # it stops answering
    wrong_time_at_s: FaultTime = None  # it answers with the time of another tick
    garbage_at_s: FaultTime = None  # it answers with random bytes
    noise_at_s: FaultTime = None  # it sends random bytes between intact frames

    def texts(self) -> tuple[str, ...]:
        """Return the faults as arguments of the mock's command line: 'die@12.5'."""
        times = {name.removesuffix("_at_s"): getattr(self, name) for name in type(self).model_fields}
        return tuple(f"{kind}@{t_s!r}" for kind, t_s in times.items() if t_s is not None)


def _number_as_text(value: Any) -> Any:
    """Allow the number of an airframe without quotes."""
    return str(value) if type(value) is int else value


class AutopilotSettings(Section):
    """The flight controller and the link to it."""

    kind: str = "mock"
    transport: Literal["pty", "loopback"] = "pty"  # mock only; loopback: same bytes without a serial line
    # Configured in the flight controller; PX4: name or number of an airframe. null: the vehicle's rotors.
    airframe: Annotated[str | None, BeforeValidator(_number_as_text)] = None
    # HIL_SENSOR messages without a reply while the firmware boots. null: unknown, free-running until the first reply.
    boot_sensors: Annotated[int, Field(ge=0, le=300)] | None = 20
    reply_timeout_s: Annotated[float, Field(gt=0, le=600)] = 5.0  # wall clock; then the run ends as ERROR
    connect_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 20.0  # wall clock, until the first message
    start: bool = True  # false: the user starts it
    # Serial device, used instead of `transport`: /dev/ttyACM0, or usb:SERIAL with the USB serial number of the board.
    port: str | None = None
    # MAVLink on a link of its own: a second serial device (ardupilot_eahrs), or udp:PORT, tcp:PORT or none
    # (ardupilot_sitl with start: false).
    mavlink_port: str | None = None
    baud: Annotated[int, Field(ge=1200, le=12_000_000)] = 921_600  # of a UART; USB ignores it
    binary: str | None = None  # the user's own firmware build, for rigs that need one
    instance: Annotated[int, Field(ge=0, le=99)] = 0  # of a simulated autopilot; added to its network ports
    arguments: tuple[str, ...] = ()  # more command-line arguments of `binary`
    env: dict[str, str] = Field(default_factory=dict)  # environment of `binary`
    params: dict[str, float] = Field(default_factory=dict)  # flight-controller parameters by name
    # A file of parameters that a ground station has saved, and what was read from it: set like `params`, which go over
    # them, but those that the firmware does not have are left out.
    params_file: str | None = None
    params_of_file: dict[str, float] = Field(default_factory=dict)
    reconnect_s: Annotated[float, Field(ge=0, le=600)] = (
        10.0  # free-running links: longest time that a board may be unplugged
    )
    # Runs the bench and the firmware that it starts on one processor, the firmware first. Timing is then more
    # repeatable; on a busy machine the bench stops sharing by itself. false: the bench has a processor of its own and
    # records while the firmware computes; that needs two processors that other programs leave free. With several
    # vehicles it has no effect: bench and firmware use all processors.
    share_processor: bool = True
    # A reboot of ArduPilot SITL in the run: ERROR, or the vehicle returns to its start and the run continues.
    on_restart: Literal["error", "reset"] = "error"
    # In a bench with several vehicles: if this autopilot is lost, the run ends as ERROR, or its vehicle falls and the
    # others fly on.
    on_loss: Literal["error", "go_on"] = "error"
    signing_key_file: str | None = None  # signs the bench's own MAVLink messages; null: unsigned
    faults: MockFaults = MockFaults()

    @property
    def all_params(self) -> dict[str, float]:
        """Parameters of the file, with `params` over them."""
        return self.params_of_file | self.params

    @property
    def system_id(self) -> int:
        """MAVLink system id of an autopilot that the bench starts; PX4 and ArduPilot number theirs alike."""
        return self.instance + 1

    @field_validator("env")
    @classmethod
    def _names_of_variables(cls, env: dict[str, str]) -> dict[str, str]:
        for name, value in env.items():
            if not re.fullmatch(ENV_NAME, name) or "\0" in value:
                raise ValueError(f"{name!r} cannot be an environment variable")
        return env

    @field_validator("params", "params_of_file")
    @classmethod
    def _names_fit_mavlink(cls, params: dict[str, float]) -> dict[str, float]:
        for name in params:
            if not re.fullmatch(r"[A-Z0-9_]{1,16}", name):
                raise ValueError(f"{name!r} cannot be a parameter: 1 to 16 of A-Z, 0-9 and _")
        return params
