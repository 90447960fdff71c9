"""Sensor faults from a given simulated time on, applied to the samples of any sensor.

    freeze     the values stay as at the beginning of the fault; timestamps and sequence continue
    offset     adds `value`
    drift      adds `rate_per_s` (t - at_s)
    stuck_bit  bit `bit` of the output word (two's complement) is fixed at `level`
    dropout    no sample: `sample` returns None
    blocked    ports of a pitot-static tube are blocked by dirt, water or ice (sim/sensors/pitot.py)
    jammer     a transmitter of noise disturbs a GPS that sees the sky (sim/gnss/interference.py)
    spoofer    a transmitter of false signals, which hold the receiver where they are strong enough

A fault is active while at_s <= t < until_s. Offset, drift and stuck_bit act on one field of the sample, by default its
main field, on one axis or on all. Values derived from the field are computed anew (the pressure altitude from the
pressure). A fault changes no sensor's noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, TypeAdapter, model_validator

from signals.documents.validate import StrictModel
from signals.samples import (
    BaroSample,
    DifferentialPressureSample,
    FlowSample,
    GpsSample,
    ImageSample,
    ImuSample,
    MagSample,
    OdometrySample,
    PointCloudSample,
    RadarSample,
    RangeSample,
    Sample,
    ScalarSample,
    TruthState,
    VaneSample,
)
from signals.time import NS_PER_S
from sim.gnss.interference import Emitter, Spoofer
from sim.scene.atmosphere import pressure_altitude_m
from sim.sensors.blockage import BlockedPorts
from sim.sensors.sensor import Sensor

if TYPE_CHECKING:
    from sim.gnss.receiver import SkyReceiver

# Fields that faults can act on, the main field first, with the number of axes (1: a scalar).
FAULT_FIELDS: dict[type, dict[str, int]] = {
    ImuSample: {"accel_mps2": 3, "gyro_radps": 3, "temperature_degc": 1},
    MagSample: {"field_tesla": 3},
    BaroSample: {"pressure_pa": 1, "temperature_degc": 1},
    GpsSample: {"altitude_m": 1, "latitude_deg": 1, "longitude_deg": 1, "v_W": 3},
    RangeSample: {"distance_m": 1},
    ScalarSample: {"value": 1},
    FlowSample: {"flow_rad": 2, "gyro_rad": 3, "distance_m": 1},
    OdometrySample: {"p_OB": 3, "v_OB_B": 3},
    DifferentialPressureSample: {"differential_pressure_pa": 1, "temperature_degc": 1},
    VaneSample: {"angle_of_attack_rad": 1, "sideslip_rad": 1},
    # Frames can only freeze or drop out.
    ImageSample: {},
    PointCloudSample: {},
    RadarSample: {},
}
# Kinds of faults inside the sensor, which only sensors of one sample type have.
INNER_FAULTS: dict[str, type] = {
    "blocked": DifferentialPressureSample,
    "jammer": GpsSample,
    "spoofer": GpsSample,
}
TRANSMITTERS = ("jammer", "spoofer")  # of a gps with `sky`
_INNER_WHY = {
    "blocked": "only a pitot tube has ports",
    "jammer": "only a gps hears transmitters",
    "spoofer": "only a gps hears transmitters",
}
_STAMPS = 3  # seq, t_capture_ns, t_available_ns: faults leave them unchanged
_AXES = "xyz"
_WORD_BITS = 32
_NO_SAMPLE, _NO_CHANGE = "no sample fell into its time", "it changed no sample"  # why a fault has had no effect

Instant = Annotated[float, Field(ge=0.0, le=1e6)]
Size = Annotated[float, Field(ge=-1e9, le=1e9)]
Place = Annotated[float, Field(ge=-1e6, le=1e6)]
Speed = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class _Fault(StrictModel):
    """Common keys of all faults."""

    sensor: Annotated[str, Field(min_length=1)]  # name in the bench file
    at_s: Instant
    until_s: Instant | None = None  # null: to the end

    @model_validator(mode="after")
    def _ends_after_it_began(self) -> _Fault:
        if self.until_s is not None and not self.until_s > self.at_s:
            raise ValueError(f"until_s {self.until_s:g} must come after at_s {self.at_s:g}")
        return self

    @property
    def span_ns(self) -> tuple[int, int | None]:
        """Beginning and end [ns]; None: no end."""
        end = None if self.until_s is None else round(self.until_s * NS_PER_S)
        return round(self.at_s * NS_PER_S), end


class Freeze(_Fault):
    """Fault that freezes the values."""

    kind: Literal["freeze"]


class Dropout(_Fault):
    """Fault that suppresses the samples."""

    kind: Literal["dropout"]


class Blocked(_Fault):
    """Fault that blocks the ports of a pitot-static tube."""

    kind: Literal["blocked"]
    port: Literal["total", "static", "both"] = "total"
    closing_s: Annotated[float, Field(ge=0.0, le=1e5)] = 0.0  # the opening shrinks linearly in this time (ice)
    leak: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0  # of a drain hole, over the conductance of the open port
    response_s: Annotated[float, Field(gt=0.0, le=1e4)] = 0.2  # time constant of a line with an open port

    def ports(self, since_s: float) -> BlockedPorts:
        """Return the blockage `since_s` after the fault began."""
        open_share = max(0.0, 1.0 - since_s / self.closing_s) if self.closing_s > 0.0 else 0.0
        return BlockedPorts(self.port, open_share, self.leak, self.response_s)


class _Transmitter(_Fault):
    """Base of transmitters on the frequency of a GPS."""

    kind: str
    place_m: tuple[Place, Place, Place]  # W
    power_dbm: Annotated[float, Field(ge=-100.0, le=100.0)]  # EIRP
    shadow_db: Annotated[float, Field(ge=0.0, le=100.0)] = 25.0  # lost while a solid is in between

    def emitter(self, band: str) -> Emitter:
        """Return the transmitter as a receiver hears it."""
        return Emitter(self.place_m, self.power_dbm - 30.0, band, self.shadow_db)


class Jammer(_Transmitter):
    """Fault that puts a jammer into the scene."""

    kind: Literal["jammer"]
    band: Literal["narrow", "code", "wide"] = "wide"


class SpoofedPlace(_Transmitter):
    """Fault that puts a spoofer into the scene."""

    kind: Literal["spoofer"]
    capture_db: Annotated[float, Field(ge=0.0, le=60.0)] = 6.0  # over the satellites, from which it holds the receiver
    offset_m: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)  # of the false place from the true one, W
    velocity_mps: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)  # at which the false place moves away


class _ValueFault(_Fault):
    """Base of faults of one field."""

    field: str | None = None  # null: the main field
    axis: Literal["x", "y", "z"] | None = None  # null: all axes


class Offset(_ValueFault):
    """Fault that adds a constant [unit of the field]."""

    kind: Literal["offset"]
    value: Size


class DriftAway(_ValueFault):
    """Fault that adds a ramp [unit of the field per second]."""

    kind: Literal["drift"]
    rate_per_s: Size


class StuckBit(_ValueFault):
    """Fault that fixes one bit of the output word."""

    kind: Literal["stuck_bit"]
    bit: Annotated[int, Field(ge=0, lt=_WORD_BITS)]  # 0: the lowest
    level: Annotated[int, Field(ge=0, le=1)]


SensorFault = Annotated[
    Freeze | Dropout | Offset | DriftAway | StuckBit | Blocked | Jammer | SpoofedPlace, Field(discriminator="kind")
]
FAULT_LIST: TypeAdapter[list[Any]] = TypeAdapter(list[SensorFault])


def fault_problems(faults: Sequence[Any], sensors: Mapping[str, type]) -> Iterator[tuple[int, str, str]]:
    """Yield (index, key, message) of faults that do not fit `sensors`: name -> sample type."""
    for index, fault in enumerate(faults):
        kind = sensors.get(fault.sensor)
        if kind is None:
            yield index, "sensor", f"is unknown: {fault.sensor!r} (sensors: {', '.join(sensors) or 'none'})"
            continue
        inner = INNER_FAULTS.get(fault.kind, kind)
        if inner is not kind:
            yield index, "kind", f"is {fault.kind!r}, which {fault.sensor!r} cannot have: {_INNER_WHY[fault.kind]}"
            continue
        if not isinstance(fault, _ValueFault):
            continue
        fields = FAULT_FIELDS[kind]
        if not fields:
            yield index, "kind", f"does not act on frames: the frames of {fault.sensor!r} can only freeze or drop out"
            continue
        name = acted_field(fault, kind)
        if name not in fields:
            yield index, "field", f"is unknown: {name!r} (fields of {fault.sensor!r}: {', '.join(fields)})"
            continue
        axes = _AXES[: fields[name]] if fields[name] > 1 else ""
        if fault.axis is not None and fault.axis not in axes:
            have = f"only {', '.join(axes)}" if axes else "no axes"
            yield index, "axis", f"is {fault.axis!r}, but {name!r} of {fault.sensor!r} has {have}"


def acted_field(fault: Any, sample_type: type) -> str | None:
    """Return the field of the sample on which a fault acts; None: the whole sample."""
    return (fault.field or next(iter(FAULT_FIELDS[sample_type]), None)) if isinstance(fault, _ValueFault) else None


EventSink = Callable[[int, str, str], None]  # t_ns, kind, text: `Recorder.event` fits


class FaultySensor:
    """Sensor with faults. Its name, rates and resolution are those of the sensor itself."""

    def __init__(self, sensor: Sensor, faults: Sequence[Any], *, on_event: EventSink | None = None) -> None:
        """`faults`: faults of this sensor, applied in their order. Raises ValueError if one does not fit the sensor."""
        problems = list(fault_problems(faults, {sensor.name: sensor.sample_type}))
        if problems:
            raise ValueError("; ".join(f"fault {i}: {key} {text}" for i, key, text in problems))
        self.name = sensor.name
        self.sample_type = sensor.sample_type
        self.period_ns = sensor.period_ns
        self.latency_ns = sensor.latency_ns
        self.resolution = sensor.resolution
        self._sensor = sensor
        self._has_ports = hasattr(sensor, "blockage")
        self._receiver: SkyReceiver | None = getattr(sensor, "receiver", None)
        self._expect_sky(faults)
        self._spans = [(fault, *fault.span_ns) for fault in faults]
        self._active = [False] * len(faults)
        self._unmet = [_NO_SAMPLE] * len(faults)  # why each has had no effect; empty: it had one
        self._frozen: dict[int, tuple[Any, ...]] = {}
        self._last: tuple[Any, ...] | None = None
        self._on_event = on_event

    def inject(self, fault: Any) -> None:
        """Add a fault during the run. Raises ValueError if it does not fit the sensor."""
        for _, key, text in fault_problems((fault,), {self.name: self.sample_type}):
            raise ValueError(f"fault of {fault.sensor}: {key} {text}")
        self._expect_sky((fault,))
        self._spans.append((fault, *fault.span_ns))
        self._active.append(False)
        self._unmet.append(_NO_SAMPLE)

    @property
    def unmet(self) -> list[tuple[Any, str]]:
        """Faults that have changed no sample so far, each with the reason."""
        return [(fault, why) for (fault, _, _), why in zip(self._spans, self._unmet, strict=True) if why]

    def sample(self, truth: TruthState, seq: int) -> Sample | None:
        """Return sample `seq` with the faults that are active at `truth.t_ns`; None during a dropout."""
        if self._has_ports:
            self._sensor.blockage.set(self._blocked_ports(truth.t_ns))  # type: ignore[attr-defined]
        if self._receiver is not None:
            self._transmit(self._receiver, truth.t_ns)
        sample = self._sensor.sample(truth, seq)
        t_ns, dropped = truth.t_ns, False
        values = sample[_STAMPS:]
        for i, (fault, begin, end) in enumerate(self._spans):
            active = begin <= t_ns and (end is None or t_ns < end)
            if active != self._active[i]:
                self._active[i] = active
                self._frozen.pop(i, None)
                if self._on_event is not None:
                    self._on_event(t_ns, "fault", f"{self.name}: {fault.kind} {'began' if active else 'ended'}")
            if not active:
                continue
            before, self._unmet[i] = self._unmet[i], ""
            if isinstance(fault, Blocked | _Transmitter):
                continue  # in the sample already
            if isinstance(fault, Dropout):
                dropped = True
            elif isinstance(fault, Freeze):
                values = self._frozen.setdefault(i, values if self._last is None else self._last)
            else:
                changed = self._changed(values, fault, (t_ns - begin) / NS_PER_S)
                self._unmet[i] = _NO_CHANGE if before and changed == values else ""
                values = changed
        if dropped:
            return None
        self._last = values
        faulty: Sample = self.sample_type(*sample[:_STAMPS], *values)
        return faulty

    def _expect_sky(self, faults: Sequence[Any]) -> None:
        for fault in faults:
            if isinstance(fault, _Transmitter) and self._receiver is None:
                raise ValueError(f"fault of {fault.sensor}: kind is {fault.kind!r}, which needs a gps with `sky`")

    def _transmit(self, receiver: SkyReceiver, t_ns: int) -> None:
        """Give the receiver the transmitters that are on."""
        active = [fault for fault, begin, end in self._spans if begin <= t_ns and (end is None or t_ns < end)]
        receiver.jammers = tuple(fault.emitter(fault.band) for fault in active if isinstance(fault, Jammer))
        receiver.spoofers = tuple(
            Spoofer(fault.emitter("code"), fault.capture_db, fault.offset_m, fault.velocity_mps)
            for fault in active
            if isinstance(fault, SpoofedPlace)
        )

    def _blocked_ports(self, t_ns: int) -> BlockedPorts | None:
        """Return the blockage by the last of the active faults."""
        found = None
        for fault, begin, end in self._spans:
            if isinstance(fault, Blocked) and begin <= t_ns and (end is None or t_ns < end):
                found = fault.ports((t_ns - begin) / NS_PER_S)
        return found

    def _changed(self, values: tuple[Any, ...], fault: Any, since_s: float) -> tuple[Any, ...]:
        name = acted_field(fault, self.sample_type)
        assert name is not None
        at = self.sample_type._fields.index(name) - _STAMPS  # type: ignore[attr-defined]
        step = self.resolution.get(name, 1.0)
        old = values[at]
        if isinstance(old, tuple):
            axis = None if fault.axis is None else _AXES.index(fault.axis)
            new: Any = tuple(
                _value(x, fault, since_s, step) if axis is None or i == axis else x for i, x in enumerate(old)
            )
        else:
            new = _value(old, fault, since_s, step)
        changed = [*values[:at], new, *values[at + 1 :]]
        if name == "pressure_pa":
            # A fault may make the pressure negative, which has no altitude.
            changed[at] = max(new, 1.0)
            changed[at + 1] = pressure_altitude_m(changed[at])
        return tuple(changed)


def _value(x: float, fault: Any, since_s: float, step: float) -> float:
    if isinstance(fault, Offset):
        return x + fault.value
    if isinstance(fault, DriftAway):
        return x + fault.rate_per_s * since_s
    counts = math.floor(x / step + 0.5)
    mask = 1 << fault.bit
    stuck = counts | mask if fault.level else counts & ~mask
    # The driver reads a 32-bit two's-complement word: setting the top bit makes it negative.
    stuck = (stuck + (1 << (_WORD_BITS - 1))) % (1 << _WORD_BITS) - (1 << (_WORD_BITS - 1))
    return x + (stuck - counts) * step
