"""Methods that fly a vehicle by its attitude: angles or their rates, with a height or a throttle, and motor commands.

Angles are those of the wire: radians, in FRD and NED.
"""

from __future__ import annotations

from hil.apps.airsim.api.control import DURATION, move, numbers
from hil.apps.airsim.flight import timed
from hil.apps.airsim.rpc.methods import Method
from hil.apps.airsim.simulation import Simulation


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim = simulation
    return [
        move(
            sim, "moveByMotorPWMs",
            lambda a, b, c, d, duration: timed.move_by_motor_pwms((a, b, c, d), duration),
            *numbers("front_right_pwm", "rear_left_pwm", "front_left_pwm", "rear_right_pwm"), DURATION,
        ),
        move(
            sim, "moveByRollPitchYawZ",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yaw_z((roll, pitch), *rest),
            *numbers("roll", "pitch", "yaw", "z"), DURATION,
        ),
        move(
            sim, "moveByRollPitchYawThrottle",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yaw_throttle((roll, pitch), *rest),
            *numbers("roll", "pitch", "yaw", "throttle"), DURATION,
        ),
        move(
            sim, "moveByRollPitchYawrateThrottle",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yawrate_throttle((roll, pitch), *rest),
            *numbers("roll", "pitch", "yaw_rate", "throttle"), DURATION,
        ),
        move(
            sim, "moveByRollPitchYawrateZ",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yawrate_z((roll, pitch), *rest),
            *numbers("roll", "pitch", "yaw_rate", "z"), DURATION,
        ),
        move(
            sim, "moveByAngleRatesZ",
            lambda x, y, z, *rest: timed.move_by_angle_rates_z((x, y, z), *rest),
            *numbers("roll_rate", "pitch_rate", "yaw_rate", "z"), DURATION,
        ),
        move(
            sim, "moveByAngleRatesThrottle",
            lambda x, y, z, *rest: timed.move_by_angle_rates_throttle((x, y, z), *rest),
            *numbers("roll_rate", "pitch_rate", "yaw_rate", "throttle"), DURATION,
        ),
        # Clients before 2022:
        *(
            move(
            sim,     name,
                lambda pitch, roll, z, yaw, duration: timed.move_by_roll_pitch_yaw_z((roll, pitch), yaw, z, duration),
                *numbers("pitch", "roll", "z", "yaw"), DURATION,
            )
            for name in ("moveByAngleZ", "moveByAngle")
        ),
        move(
            sim, "moveByAngleThrottle",
            lambda pitch, roll, throttle, *rest: timed.move_by_roll_pitch_yawrate_throttle(
                (roll, pitch), rest[0], throttle, rest[1]
            ),
            *numbers("pitch", "roll", "throttle", "yaw_rate"), DURATION,
        ),
    ]  # fmt: skip
