"""Methods that fly a vehicle by its attitude: angles or their rates, with a height or a throttle, and motor commands.

Angles are those of the wire: radians, in FRD and NED.
"""

from __future__ import annotations

from hil.apps.airsim.api.control import DURATION, move, numbers
from hil.apps.airsim.flight import timed
from hil.apps.airsim.flight.move import Move
from hil.apps.airsim.rpc.methods import Method
from hil.apps.airsim.simulation import Simulation

_HELD = {
    "moveByRollPitchYawZ": ("roll", "pitch", "yaw", "z"),
    "moveByRollPitchYawThrottle": ("roll", "pitch", "yaw", "throttle"),
    "moveByRollPitchYawrateThrottle": ("roll", "pitch", "yaw_rate", "throttle"),
    "moveByRollPitchYawrateZ": ("roll", "pitch", "yaw_rate", "z"),
    "moveByAngleRatesZ": ("roll_rate", "pitch_rate", "yaw_rate", "z"),
    "moveByAngleRatesThrottle": ("roll_rate", "pitch_rate", "yaw_rate", "throttle"),
    # Clients before 2022:
    "moveByAngleZ": ("pitch", "roll", "z", "yaw"),
    "moveByAngle": ("pitch", "roll", "z", "yaw"),
    "moveByAngleThrottle": ("pitch", "roll", "throttle", "yaw_rate"),
}


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""
    return [
        move(
            sim, "moveByMotorPWMs",
            lambda a, b, c, d, duration: timed.move_by_motor_pwms((a, b, c, d), duration),
            *numbers("front_right_pwm", "rear_left_pwm", "front_left_pwm", "rear_right_pwm"), DURATION,
        ),
        *(_holding(sim, name, held) for name, held in _HELD.items()),
    ]  # fmt: skip


def _holding(sim: Simulation, name: str, held: tuple[str, ...]) -> Method:
    def make(*arguments: float) -> Move:
        *values, duration_s = arguments
        return timed.move_by_attitude(duration_s, **dict(zip(held, values, strict=True)))

    return move(sim, name, make, *numbers(*held), DURATION)
