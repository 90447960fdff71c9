"""Frames as a client gets them, without a bench: sensors sampled along a true motion, released when they are available.

For closed loops and recordings that fly no autopilot. What a frame holds is `hil.companion.bundle`'s business.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from hil.companion.bundle import Bundle, Collector
from hil.companion.started import use_client
from hil.companion.topics import TRUTH
from hil.signals.samples import Sample, TruthState
from sim.sensors.sensor import Sensor

if TYPE_CHECKING:
    from hil_companion.frame import Frame

Change = Callable[[TruthState, str, Any], Any]  # a sample as it is, another one, or None: there is none


class OfflineFrames:
    """`add` every tick of `tick_ns`, in order; `take` when a frame is due. `change` may alter what a sensor says."""

    def __init__(
        self, sensors: Mapping[str, Sensor], *, tick_ns: int, truth: bool = True, change: Change | None = None
    ) -> None:
        """`truth`: frames have the topic truth too."""
        self._sensors, self._tick_ns, self._change = sensors, tick_ns, change
        self._topics = (TRUTH, *sensors) if truth else tuple(sensors)
        self._collector = Collector(self._topics)
        self._seq = dict.fromkeys(sensors, 0)
        self._waiting: list[tuple[int, str, Sample]] = []
        self._number = 0

    def add(self, truth: TruthState) -> None:
        """Sample what is due; release what has left its sensor."""
        for name, sensor in self._sensors.items():
            period_ns = sensor.period_ns
            if truth.t_ns // period_ns == (truth.t_ns - self._tick_ns) // period_ns:
                continue
            sample = sensor.sample(truth, self._seq[name])
            self._seq[name] += 1
            if self._change is not None:
                sample = self._change(truth, name, sample)
            if sample is not None:
                self._waiting.append((sample.t_available_ns, name, sample))
        due = sorted((w for w in self._waiting if w[0] <= truth.t_ns), key=lambda w: w[:2])
        if due:
            self._waiting = [w for w in self._waiting if w[0] > truth.t_ns]
            self._collector.add([(name, sample) for _, name, sample in due])

    def take(self, truth: TruthState) -> Frame:
        """What came since the frame before."""
        frame = client_frame(self._collector.take(self._number, truth), self._topics)
        self._number += 1
        return frame


def client_frame(bundle: Bundle, topics: tuple[str, ...]) -> Frame:
    """As the client's library makes it of what comes over the wire."""
    use_client()
    from hil_companion.frame import Frame as ClientFrame
    from hil_companion.frame import Sample as ClientSample

    samples = {
        s.topic: ClientSample(s.topic, s.seq, s.t_capture_ns, s.t_available_ns, dict(s.values), dict(s.arrays))
        for s in bundle.frame(topics).samples
    }
    header = {"frame": bundle.number, "tick": bundle.tick, "t_ns": bundle.t_ns, "t_sent_ns": 0, "dropped": 0}
    return ClientFrame(header, samples, in_ring=False, t_received_ns=0)
