"""Checks between settings of a bench that are each valid alone."""

from __future__ import annotations

import math

from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from hil.config.sensors.resolve import sample_types
from signals.documents.document import Place
from signals.documents.validate import at
from signals.errors import Problem
from sim.physics.faults import misfits
from sim.physics.surface_faults import surface_misfits
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.sensors.catalog import KINDS
from sim.sensors.faults import fault_problems
from sim.sensors.magnetometer import magnetic_field_W_tesla

# Below, a compass gives no heading: 0.2 uT of hard iron turn it by 4 degrees, and the mock's estimator rejects a field
# within 3 degrees of gravity. The World Magnetic Model's own zones: blackout below 2 uT, caution up to 6 uT.
_LEAST_HORIZONTAL_TESLA = 3.0e-6
_LEAST_SWEEPS_HZ = 0.5  # times of points are nanoseconds of 32 bits, within 2.147 s of the sweep's end


def rate_problem(rate_hz: float, config: BenchConfig) -> str:
    """Explain why this rate does not fit the tick of the bench; '' if it does."""
    if rate_hz > config.tick_hz:
        return f"must be at most the tick's rate, {config.tick_hz} Hz, not {rate_hz:g} Hz"
    if abs(rate_hz * 1000 - round(rate_hz * 1000)) > 1e-6 or rate_hz < 0.001:
        return f"must be a whole number of millihertz, not {rate_hz!r} Hz"
    return ""


def cross_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report settings that exclude each other, or do not fit the tick of the bench."""
    problems: list[Problem] = []

    def report(place: Place, message: str, hint: str = "") -> None:
        problems.append(at(settings, place, message, hint))

    for name, sensor in config.sensors.items():
        place = ("sensors", name, "rate_hz")
        if sensor.rate_hz > config.tick_hz:
            report(place, rate_problem(sensor.rate_hz, config), "lower it or raise tick_hz")
        elif sensor.kind == "imu" and sensor.rate_hz != config.tick_hz:
            message = f"must be the tick's rate, {config.tick_hz} Hz, not {sensor.rate_hz:g} Hz"
            report(place, message, "an imu is read at every tick: leave rate_hz out")
        elif message := rate_problem(sensor.rate_hz, config):
            report(place, message)
        elif KINDS[sensor.kind].sweeps and sensor.rate_hz < _LEAST_SWEEPS_HZ:
            message = f"must be at least {_LEAST_SWEEPS_HZ:g} Hz, not {sensor.rate_hz:g} Hz"
            report(place, message, "a sweep takes its whole period, and its points state times within 2.1 s")
    for index, key, message in fault_problems(config.faults.sensors, sample_types(config)):
        report(("faults", "sensors", index, key), message)
    if config.ros2.flies and (config.companion.flies or config.manual.device is not None):
        other = "companion.control" if config.companion.flies else "manual.device"
        report(("ros2", "control"), f"is true, and so is {other}: both would command the vehicle", "leave one out")
    if config.follow.flies:
        others = {
            "mission": config.mission is not None,
            "companion.control": config.companion.flies,
            "ros2.control": config.ros2.flies,
            "manual.device": config.manual.device is not None,
        }
        for other in (name for name, flies in others.items() if flies):
            hint = "--set mission=null" if other == "mission" else "leave one out"
            report(("follow", "log"), f"is set, and so is {other}: both would command the vehicle", hint)
        if missing := config.missing_sensors():
            message = f"needs sensors with a {' and a '.join(missing)} that feeds the flight controller"
            report(("follow", "log"), message)
    if config.foxglove.port is not None and config.foxglove.paused and not config.autopilot.lockstep:
        message = "is true, and this autopilot runs on wall-clock time: it cannot be held"
        report(("foxglove", "paused"), message, "set it to false")
    if config.ros2.setpoint_hz > config.tick_hz:
        message = f"must be at most the tick's rate, {config.tick_hz} Hz, not {config.ros2.setpoint_hz:g} Hz"
        report(("ros2", "setpoint_hz"), message)
    step_us = config.physics.step_us
    if step_us is not None and config.tick_ns % (step_us * 1000):
        message = f"must divide the tick of {config.tick_ns / 1000:g} us, and {step_us} us does not"
        report(("physics", "step_us"), message)
    if config.goal is not None:
        if config.mission is not None:
            report(("goal",), "cannot go with a mission: a flight is judged by one of them", "--set mission=null")
        if not config.companion.flies:
            report(("goal",), "needs a companion that finds the way", "companion: {start: [explore], control: true}")
        way_m, within_m = math.dist(config.start.p_W[:2], config.goal.p_W[:2]), config.goal.within_m
        if within_m is not None and within_m >= way_m and config.goal.outcome == "goal":
            message = f"is {within_m:g} m, and the start is {way_m:.1f} m from the goal: nothing would have to be flown"
            report(("goal", "within_m"), message)
    if not config.autopilot.lockstep and config.pace not in (None, 1.0):
        report(("pace",), f"must be 1 or null, not {config.pace:g}: a free-running autopilot keeps wall-clock time")
    return problems


def vehicle_problems(config: BenchConfig, vehicle: Vehicle, settings: Settings) -> list[Problem]:
    """Report settings that do not fit the vehicle."""
    problems = [
        at(settings, ("faults", "rotors", index, key), message)
        for index, key, message in misfits(config.faults.rotors, vehicle)
    ]
    problems += [
        at(settings, ("faults", "surfaces", index, key), message)
        for index, key, message in surface_misfits(config.faults.surfaces, vehicle)
    ]
    if config.physics.effects.battery and vehicle.battery is None:
        message = f"is true, but the vehicle {vehicle.name!r} has no battery"
        problems.append(at(settings, ("physics", "effects", "battery"), message))
    if config.vibration != "off" and not vehicle.rotors:
        message = f"is that of rotors, and the vehicle {vehicle.name!r} has none"
        problems.append(at(settings, ("vibration",), message))
    return problems


def site_problems(config: BenchConfig, scene: Scene) -> list[Problem]:
    """Report a site so near a magnetic pole that no autopilot finds its heading with a magnetometer."""
    if not any(sensor.kind == "magnetometer" for sensor in config.sensors.values()):
        return []
    horizontal = math.hypot(*magnetic_field_W_tesla(scene.site)[:2])
    if horizontal >= _LEAST_HORIZONTAL_TESLA:
        return []
    site, least_ut = scene.site, 1e6 * _LEAST_HORIZONTAL_TESLA
    message = (
        f"lies at a magnetic pole: the horizontal field at {site.latitude_deg:g}, {site.longitude_deg:g} is "
        f"{1e6 * horizontal:.1f} uT, and a compass needs {least_ut:g} uT"
    )
    return [scene.file.problem(("site",), message, "choose a site farther from the magnetic poles")]
