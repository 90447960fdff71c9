"""Facts of ArduCopter that both links share: its program, and its frame for the rotors of a vehicle."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_bridge.autopilots.installation import Aircraft, FixedWing, Multirotor, Vtol
from firmware_bridge.autopilots.profile import Misfit, Program
from firmware_bridge.links.ardupilot.frames import Frame, frame_names, frame_of
from signals.errors import LinkError

PROGRAM = Program(
    "ArduCopter",
    b"ArduCopter V",  # ArduPlane has the name alone, too
    "`./waf configure --board sitl && ./waf copter` in ardupilot makes build/sitl/bin/arducopter",
)
_LEAST_UPRIGHT = 0.9  # vertical part of an axis: the rotors of ArduPilot's frames are upright


def frame_for(vehicle: Multirotor) -> Frame | None:
    """Return ArduCopter's frame for the rotors of the vehicle, None if it has none."""
    if any(rotor.axis[2] < _LEAST_UPRIGHT for rotor in vehicle.rotors):
        return None
    return frame_of([(rotor.position_m[0], rotor.position_m[1], rotor.spin) for rotor in vehicle.rotors])


def frame_parameters(vehicle: Multirotor) -> dict[str, float]:
    """Return the parameters of ArduCopter's frame for the rotors. LinkError if it has none."""
    frame = frame_for(vehicle)
    if frame is None:
        raise LinkError("ardupilot", f"has no frame with the rotors of the vehicle {vehicle.name!r}")
    return frame.parameters()


def frame_misfits(vehicle: Aircraft) -> Sequence[Misfit]:
    """Report a vehicle with rotors, or lifters, for which ArduPilot has no frame."""
    if isinstance(vehicle, FixedWing):
        return ()
    lifting = vehicle.hover if isinstance(vehicle, Vtol) else vehicle
    if frame_for(lifting) is not None:
        return ()
    count = len(lifting.rotors)
    message = f"has rotors for which ArduCopter has no frame: {vehicle.name!r} with {count}"
    hint = f"of so many motors it has {', '.join(frame_names(count)) or 'none'}, with upright rotors"
    return (Misfit(("vehicle",), message, hint),)
