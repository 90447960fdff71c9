"""Sensors of one vehicle; a sample is computed when a client asks for it.

Sample k of a sensor of rate F measures the state at k / F, whenever it is asked for, and is valid from then on: two
questions within 1 / F have the same answer, with the time stamp of the sample. A latency gives the state and the time
stamp of so long ago. The noise of sample k depends on the vehicle, the sensor's name and k alone. So it does not matter
who asks for which samples. Objects that clients move count as they stand at the first question.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.past import Past
from hil.apps.airsim.world.sensors.barometer import Barometer
from hil.apps.airsim.world.sensors.distance import Distance
from hil.apps.airsim.world.sensors.gps import Gps
from hil.apps.airsim.world.sensors.imu import Imu
from hil.apps.airsim.world.sensors.lidar import Lidar
from hil.apps.airsim.world.sensors.magnetometer import Magnetometer
from hil.apps.airsim.world.sensors.sensor import Measured, Sensor
from signals.time import NS_PER_S, period_ns_from_hz

_SENSORS: Mapping[type, Callable[[str, Any, Measured], Sensor]] = {
    kinds.Barometer: Barometer,
    kinds.Distance: Distance,
    kinds.Gps: Gps,
    kinds.Imu: Imu,
    kinds.Lidar: Lidar,
    kinds.Magnetometer: Magnetometer,
}


class Sample(NamedTuple):
    """Sample of a sensor. `value`: see the sensor's class."""

    seq: int
    t_ns: int  # of the state that was measured
    value: Any


class SensorSuite:
    """Sensors of one vehicle by name."""

    def __init__(self, settings: Mapping[str, kinds.Sensor], measured: Measured) -> None:
        self.settings = settings
        self._measured = measured
        self._made: dict[str, Sensor] = {}
        self._last: dict[str, Sample] = {}

    def forget(self) -> None:
        """Forget the samples so far: the vehicle was put elsewhere, so the next questions get new ones."""
        self._last.clear()
        for name, sensor in self.settings.items():
            if isinstance(sensor, kinds.Imu):
                self._made.pop(name, None)  # it integrates from one attitude to the next

    def find(self, kind: type, name: str) -> str | None:
        """Return the name of an enabled sensor of a kind; "" is the first one. None: there is none."""
        names = [key for key, sensor in self.settings.items() if isinstance(sensor, kind) and sensor.enabled]
        if name == "":
            return names[0] if names else None
        return name if name in names else None

    def read(self, name: str, past: Past) -> Sample:
        """Return the sample of a sensor that is valid now. `past`: the states of the vehicle."""
        if name not in self._made:
            settings = self.settings[name]
            self._made[name] = _SENSORS[type(settings)](name, settings, self._measured)
        sensor = self._made[name]
        period_ns = period_ns_from_hz(sensor.rate_hz)
        seq = past.now.t_ns // period_ns
        sample = self._last.get(name)
        if sample is None or sample.seq != seq:
            truth = past.at(seq * period_ns)
            if sensor.latency_s:
                truth = past.before(truth.t_ns - round(sensor.latency_s * NS_PER_S))
            sample = self._last[name] = Sample(seq, truth.t_ns, sensor.sample(seq, truth))
        return sample
