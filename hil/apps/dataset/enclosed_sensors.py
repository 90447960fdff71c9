"""Sensors of a data set that are below the ground or inside something: their samples show nothing of the scene."""

from __future__ import annotations

from collections import Counter

from hil.apps.dataset.moments import Batch
from hil.apps.dataset.plan import EPOCH_NS, DatasetPlan
from signals.errors import Problem
from signals.rotation import applied, matrix_of
from signals.samples import Vec3
from signals.words import counted
from sim.physics.enclosed_points import EnclosedPoints


class EnclosedSensors:
    """Counts, batch by batch, the samples of cameras, LiDARs and radars that are taken inside something solid."""

    def __init__(self, plan: DatasetPlan) -> None:
        self._points = EnclosedPoints(plan.bench.scene, plan.bench.vehicle)
        self._mounts: dict[str, Vec3] = {
            name: sensor.parameters.mount_m or (0.0, 0.0, 0.0)
            for name, sensor in plan.frame_sensors.items()
            if getattr(sensor.parameters, "frame", None) is None  # a radar that reads a camera's pictures is there
        }
        self._samples: Counter[str] = Counter()
        self._enclosed: Counter[str] = Counter()
        self._first: dict[str, tuple[int, str]] = {}  # by sensor: time in the files [ns], and what encloses it

    def add(self, batch: Batch) -> None:
        """Count the samples of a batch."""
        for truth, due, _, _ in batch.moments:
            R_WB = matrix_of(truth.q_WB)
            found: dict[Vec3, str] = {}  # several sensors may be at one place
            for name in (sample.sensor for sample in due if sample.sensor in self._mounts):
                mount_m = self._mounts[name]
                if mount_m not in found:
                    x, y, z = applied(R_WB, mount_m)
                    found[mount_m] = self._points.around((truth.p_WB[0] + x, truth.p_WB[1] + y, truth.p_WB[2] + z))
                self._samples[name] += 1
                if found[mount_m]:
                    self._enclosed[name] += 1
                    self._first.setdefault(name, (truth.t_ns + EPOCH_NS, found[mount_m]))

    def warnings(self) -> list[str]:
        """Describe the sensors of which some samples were taken inside something, but not all."""
        return [
            f"{name} was inside something solid in {self._enclosed[name]} of {self._samples[name]} samples, which show "
            f"nothing of the scene; the first is {t_ns}, inside {what}"
            for name, (t_ns, what) in self._first.items()
            if self._enclosed[name] < self._samples[name]
        ]

    def problems(self) -> list[Problem]:
        """Return the sensors of which all samples were taken inside something."""
        return [
            Problem(
                f"sensors.{name}.mount_m",
                f"puts the sensor inside {what} in all of its {counted(self._samples[name], 'sample')}: they show "
                "nothing of the scene",
                "correct mount_m ([m], forward, left, up), or fly higher",
            )
            for name, (_, what) in self._first.items()
            if self._enclosed[name] == self._samples[name]
        ]
