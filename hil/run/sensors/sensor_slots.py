"""The sensors of one run as the scheduler samples them, with their faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hil.config import Bench
from hil.config.missions.script import SensorFault
from hil.config.schema import SensorConfig
from hil.run.loop.scheduler import SensorSlot
from hil.run.loop.stages import StagePlan
from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.recorder import Recorder
from hil.run.sensors.frame_stages import description, wanted_parts
from hil.run.sensors.simulated_sensors import SimulatedSensors, tick_rates, write_calibration
from signals.samples import Vec3
from signals.time import RateAccumulator
from sim.frame.source import SharedFrames
from sim.sensors.catalog import KINDS
from sim.sensors.faults import FaultySensor
from sim.sensors.gps import Gps
from sim.sensors.imu import Imu
from sim.sensors.lidar import Lidar
from sim.sensors.radar import Radar


class SensorSlots:
    """Builds only the sensors that have a consumer."""

    def __init__(
        self,
        bench: Bench,
        wanted: Mapping[str, SensorConfig],
        plan: StagePlan,
        frames: SharedFrames | None,
        recorder: Recorder,
        out: Path,
        wind_at: Callable[[], Vec3] | None = None,
    ) -> None:
        """Build the `wanted` sensors. `frames`: geometry for cameras, LiDARs and radars, None if none is wanted.

        `wind_at`: of the wind at the vehicle [m/s, W].
        Describes the sensors with a mount to the recorder, and writes camera calibrations to `out`.
        """
        self._bench, self._recorder = bench, recorder
        self.radars: dict[str, Radar] = {}
        self.lidars: dict[str, Lidar] = {}
        self.imus: dict[str, Imu] = {}
        self.receivers: dict[str, Gps] = {}  # that see the sky
        self.descriptions: dict[str, FrameDescription] = {}  # of sensors with a mount
        self.deviations: dict[str, Mapping[str, float]] = {}  # of the noise of a sample, by sensor and field
        self._without_faults: dict[str, Any] = {}  # by name
        self._faulty: dict[str, FaultySensor] = {}
        self._unsampled: list[SensorFault] = []  # begun during the flight
        simulated = SimulatedSensors(bench, wanted, frames, wind_at=wind_at)
        # Cameras come before the radars that read them; the order within a tick has no other effect.
        order = sorted(wanted, key=lambda name: getattr(wanted[name].parameters, "frame", None) is not None)
        for name in order:
            sensor = simulated.make(name, wanted_parts(name, wanted[name], plan))
            self._without_faults[name] = sensor
            self.deviations[name] = getattr(sensor, "deviations", {})
            recorder.describe_noise(name, self.deviations[name])
            if isinstance(sensor, Radar):
                self.radars[name] = sensor
            if isinstance(sensor, Lidar):
                self.lidars[name] = sensor
            if isinstance(sensor, Imu):
                self.imus[name] = sensor
            if isinstance(sensor, Gps) and sensor.receiver is not None:
                self.receivers[name] = sensor
            if hasattr(sensor, "mount"):
                self.descriptions[name] = description(name, sensor)
                recorder.describe(name, self.descriptions[name])
                write_calibration(out, name, sensor, rate_hz=wanted[name].rate_hz)
        self.slots = [self._slot(name, wanted[name]) for name in order]

    def inject(self, fault: SensorFault) -> None:
        """Begin a fault now; of a sensor that is not sampled it has no effect.

        Raises KeyError for a sampled sensor that was not declared as faulty or by `allow_faults`.
        """
        if any(slot.port == fault.sensor for slot in self.slots):
            self._faulty[fault.sensor].inject(fault)
        else:
            self._unsampled.append(fault)

    def allow_faults(self, name: str) -> None:
        """Let a sensor take faults that the bench does not declare. Raises ValueError if it is not sampled."""
        if name in self._faulty:
            return
        slot = next((slot for slot in self.slots if slot.port == name), None)
        if slot is None:
            raise ValueError(f"no sensor {name!r} is sampled in this run")
        self._faulty[name] = FaultySensor(self._without_faults[name], (), on_event=self._recorder.event)
        slot.sample = self._faulty[name].sample

    def unmet(self) -> list[tuple[SensorFault, str]]:
        """Return the faults that have changed no sample, each with the reason."""
        sampled = {slot.port for slot in self.slots}
        declared = (fault for fault in self._bench.config.faults.sensors if fault.sensor not in sampled)
        unsampled = [(fault, "it was not sampled: nothing reads it") for fault in (*declared, *self._unsampled)]
        return [*unsampled, *(found for sensor in self._faulty.values() for found in sensor.unmet)]

    def _slot(self, name: str, sensor: SensorConfig) -> SensorSlot:
        config, script = self._bench.config, self._bench.script
        instance = self._without_faults[name]
        faults = [fault for fault in config.faults.sensors if fault.sensor == name]
        if faults or (script is not None and name in script.sensors_at_risk):
            instance = self._faulty[name] = FaultySensor(instance, faults, on_event=self._recorder.event)
        rates = RateAccumulator(**tick_rates(sensor, config.tick_hz))
        return SensorSlot(instance, rates, after_send=KINDS[sensor.kind].needs_frames)
