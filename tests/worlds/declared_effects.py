"""Every fault, effect and action that a bench can declare, read from the registries, and what each rig says of it.

A rig accepts a declaration or refuses it with a line: `refused` finds that out by loading a bench, not from a list.
`python -m tests.worlds.declared_effects` prints the tables of docs/faults.md.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import yaml

from firmware_bridge.autopilots.catalog import PROFILES, SENSOR_KINDS
from firmware_bridge.autopilots.settings import MockFaults
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.ground_station.modes import WORDS
from hil.config import load_bench
from hil.config.missions.script import SENSOR_FAULTS
from signals.errors import ConfigError
from sim.physics.faults import RotorFault
from sim.physics.surface_faults import SurfaceFault
from sim.sensors.catalog import KINDS
from sim.sensors.faults import FAULT_FIELDS, INNER_FAULTS

RIGS = tuple(PROFILES)
# How a rig is loaded without firmware or board; nothing is opened.
LOADED = {
    "px4_sitl": {"start": False},
    "px4_hitl": {"port": "/dev/ttyACM0"},
    "ardupilot_sitl": {"start": False},
    "ardupilot_eahrs": {"port": "/dev/ttyACM0", "mavlink_port": "/dev/ttyACM1"},
}
# Sensors by kind: those of autopilots under the names that examples use. A kind without an entry fails the tests.
SENSORS: dict[str, tuple[str, dict[str, Any]]] = {
    "imu": ("imu", {"preset": "icm20689"}),
    # With a sky, for faults by transmitters; right after such a fault the samples are those of a sound receiver.
    "gps": ("gps", {"preset": "here_plus", "rate_hz": 10, "reacquisition_s": 0.0, "rtk_start_s": 0.0, "sky": {}}),
    "barometer": ("baro", {"preset": "ms5611", "rate_hz": 50}),
    "magnetometer": ("mag", {"preset": "ist8310", "rate_hz": 50}),
    "range_finder": ("range", {"preset": "lidar_lite_v3", "rate_hz": 50}),
    "optical_flow": ("flow", {"preset": "px4flow", "rate_hz": 50, "min_distance_m": 0.0}),
    "external_vision": ("vision", {"kind": "external_vision", "rate_hz": 50}),
    "pitot": ("pitot", {"preset": "sdp33", "rate_hz": 50}),
    "vane": ("vane", {"kind": "vane", "rate_hz": 50, "noise_deg": 0.2, "resolution_deg": 0.1}),
    "camera": ("front", {"kind": "camera", "resolution": [16, 12], "fov_deg": 90, "rate_hz": 10, "channels": ["rgb"]}),
    "lidar": ("lidar", {"preset": "vlp16", "rate_hz": 10}),
    "radar": ("radar", {"preset": "bgt60tr13c", "rate_hz": 10}),
    "spinning_radar": ("spinning", {"preset": "navtech_cts350x", "rate_hz": 10, "azimuths": 36, "threshold_db": 6.0}),
}
# Effects on the world, by section and key, each with a value that the flight or a picture shows.
WORLD: dict[str, dict[str, Any]] = {
    "wind": {
        "steady_W_mps": [3, 1, 0],
        "turbulence": {"level": "light"},
        "gusts": [{"at_s": 0.5, "velocity_W_mps": [0, 4, 0], "rise_s": 0.2, "hold_s": 1.0, "fall_s": 0.2}],
    },
    "weather": {"visibility_m": 60.0, "rain_mm_per_h": 80.0, "snow_mm_per_h": 3.0},
    "randomize": {
        "light": True,
        "haze": {"clear_share": 0.0},
        "textures": True,
        "people": True,
        "objects": True,
        "noise": True,
    },
    "physics.effects": {"ground_effect": False, "descent_loss": False, "battery": True, "air_density": False},
}
# One action of each kind in a script; a fault once for each thing that can have one.
ACTIONS: dict[str, dict[str, Any]] = {
    "set_mode": {"set_mode": "HOLD"},
    "arm": {"arm": True},
    "param": {"param": {"MPC_XY_CRUISE": 3.0}},
    "command": {"command": {"id": 178, "params": [1, 3, -1]}},
    "gust": {"gust": {"speed_mps": 4.0, "direction_deg": 270.0, "for_s": 1.0}},
    "fault: rotor": {"fault": {"rotor": 1, "kind": "efficiency", "factor": 0.95}},
    "fault: surface": {"fault": {"surface": "elevon_left", "kind": "stuck"}},
    "fault: sensor": {"fault": {"sensor": "gps", "kind": "dropout", "for_s": 1.0}},
    "fault: link": {"fault": {"link": {"kind": "drop", "rate": 0.1, "for_s": 1.0, "messages": ["HEARTBEAT"]}}},
    "fault: autopilot": {"fault": {"autopilot": "noise"}},
}
QUIET = {"mcap": False, "tlog": False, "report": False}


def choices(model: Any, field: str) -> tuple[str, ...]:
    """Return the values that a Literal field of a model allows."""
    return get_args(model.model_fields[field].annotation)


ROTOR_FAULTS = choices(RotorFault, "kind")
SURFACE_FAULTS = choices(SurfaceFault, "kind")
LINK_FAULTS = choices(LinkFault, "kind")
OWN_FAULTS = tuple(MockFaults.model_fields)


class SensorCell(NamedTuple):
    """A fault of a kind of sensor, of one field or (None) of the whole sample."""

    kind: str
    fault: str
    field: str | None

    def entries(self, at_s: float, until_s: float) -> list[dict[str, Any]]:
        """Return the fault as entries of `faults.sensors`: several stuck bits, of which one differs."""
        entry: dict[str, Any] = {"sensor": SENSORS[self.kind][0], "kind": self.fault, "at_s": at_s, "until_s": until_s}
        if self.field is not None:
            entry["field"] = self.field
        if self.fault != "stuck_bit":
            more = {
                "offset": {"value": 1.0},
                "drift": {"rate_per_s": 1.0},
                "blocked": {"leak": 1.0},
                "jammer": {"place_m": [50.0, 0.0, 2.0], "power_dbm": 40.0},
                "spoofer": {"place_m": [50.0, 0.0, 2.0], "power_dbm": 0.0, "offset_m": [20.0, 0.0, 0.0]},
            }.get(self.fault, {})
            return [entry | more]
        return [entry | {"bit": bit, "level": bit % 2} for bit in (3, 4, 5, 6)]


def sensor_cells(kinds: Sequence[str] = tuple(KINDS)) -> list[SensorCell]:
    """Return every fault of every field of these kinds of sensors."""
    cells = []
    for kind in kinds:
        fields = FAULT_FIELDS[KINDS[kind].sample_type]
        for fault, model in SENSOR_FAULTS.items():
            if INNER_FAULTS.get(fault, KINDS[kind].sample_type) is not KINDS[kind].sample_type:
                continue
            of_fields = "field" in model.model_fields
            cells += [SensorCell(kind, fault, field) for field in (fields if of_fields else (None,))]
    return cells


def rotor_entry(kind: str, at_s: float = 1.0, rotor: int = 0) -> dict[str, Any]:
    """Return a rotor fault of that kind with the keys that it needs."""
    more = {"efficiency": {"factor": 0.5}, "lost_blade": {"imbalance_gcm": 5.0}}.get(kind, {})
    return {"kind": kind, "rotor": rotor, "at_s": at_s, **more}


# Keys of a bench whose vehicle has motors, which the fault `desync` needs.
MOTORS: dict[str, Any] = {
    "vehicle": "x500",
    "vehicle_settings": {
        "rotor_constants": {
            "motor": {
                "kv_rpm_per_v": 920.0,
                "resistance_ohm": 0.12,
                "no_load_current_a": 0.9,
                "nominal_voltage_v": 14.8,
            }
        }
    },
}


def rotor_settings(kind: str) -> dict[str, Any]:
    """Return the keys of a bench, besides the fault, for a rotor fault of that kind."""
    return MOTORS if kind == "desync" else {}


def link_entry(kind: str, at_s: float = 1.0, for_s: float | None = None, **more: Any) -> dict[str, Any]:
    """Return a link fault of that kind with the keys that it needs."""
    rated = {} if kind in ("stall", "unplug") else {"rate": 1.0}
    delay = {"delay_s": 0.001} if kind == "delay" else {}
    return {"kind": kind, "at_s": at_s, **rated, **delay, **({} if for_s is None else {"for_s": for_s}), **more}


def bench_of(rig: str, **settings: Any) -> dict[str, Any]:
    """Return the content of a bench of that rig with the sensors of every autopilot and without a mission."""
    sensors = {name: entry for kind, (name, entry) in SENSORS.items() if kind in SENSOR_KINDS}
    own = dict(settings.pop("autopilot", {}))
    autopilot = {**LOADED.get(rig, {}), **own}
    usual = {"rig": rig, "mission": None, "vehicle": "x500", "sensors": sensors, "record": QUIET}
    usual["wind"] = {"steady_W_mps": [-3.0, 0.0, 0.0]}  # into a pitot tube that stands
    return usual | settings | {"autopilot": autopilot}


def refused(rig: str, **settings: Any) -> list[str]:
    """Return the problems for which a bench of the rig with these settings is refused; empty: it is accepted."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.yaml"
        path.write_text(yaml.safe_dump(bench_of(rig, **settings), sort_keys=False, width=10_000))
        try:
            load_bench(path)
        except ConfigError as error:
            return [str(problem) for problem in error.problems]
    return []


@cache
def accepted_cells(rig: str) -> tuple[SensorCell, ...]:
    """Return the sensor faults that a rig accepts; every other one has been refused with its line in the file."""
    cells = [cell for cell in sensor_cells() if cell.kind in SENSOR_KINDS]
    listed = [(cell, entry) for cell in cells for entry in cell.entries(1.0, 2.0)]
    problems = refused(rig, faults={"sensors": [entry for _, entry in listed]})
    # The first 100 problems are told, then their number: more are not needed.
    assert len(problems) <= 100
    bad = {cell for i, (cell, _) in enumerate(listed) if any(f"faults.sensors[{i}]." in text for text in problems)}
    assert all("bench.yaml:" in text and "(" in text for text in problems), problems
    return tuple(cell for cell in cells if cell not in bad)


# -- the tables of the docs ------------------------------------------------------------------------------------------


def sensor_table() -> str:
    """Return which sensor faults each rig accepts, fields of one kind in one row where all rigs agree."""
    groups = _groups()
    shown = {rigs[0]: ", ".join(f"`{rig}`" for rig in rigs) for rigs in groups}
    rows = ["| sensor | " + " | ".join(shown.values()) + " |", "|---" * (len(shown) + 1) + "|"]
    for kind in (kind for kind in SENSORS if kind in SENSOR_KINDS):
        fields = FAULT_FIELDS[KINDS[kind].sample_type]
        of_cells: dict[tuple[str, ...], list[str]] = {}
        for field in fields:
            of_cells.setdefault(tuple(_sensor_cell(rig, kind, field) for rig in shown), []).append(field)
        for texts, named in of_cells.items():
            what = f"`{kind}`" if len(of_cells) == 1 else f"`{kind}`: {', '.join(f'`{name}`' for name in named)}"
            rows.append(f"| {what} | " + " | ".join(texts) + " |")
    return "\n".join(rows).replace("|  |", "| |").replace("|  |", "| |")


def _groups() -> list[list[str]]:
    """Return the rigs, those together that accept the same."""
    groups: dict[Any, list[str]] = {}
    for rig in RIGS:
        groups.setdefault(accepted_cells(rig), []).append(rig)
    return list(groups.values())


def _sensor_cell(rig: str, kind: str, field: str) -> str:
    able = [cell for cell in accepted_cells(rig) if cell.kind == kind]
    taken = {cell.fault for cell in able if cell.field == field}
    if not taken:
        return ""
    taken |= {cell.fault for cell in able if cell.field is None}
    able_to_have = {cell.fault for cell in sensor_cells((kind,))}
    missing = [fault for fault in SENSOR_FAULTS if fault not in taken and fault in able_to_have]
    order = ("dropout", "freeze", "offset", "drift", "stuck_bit", "blocked", "jammer", "spoofer")
    if not missing:
        return "all"
    if len(missing) == 1:
        return f"all but `{missing[0]}`"
    return ", ".join(f"`{fault}`" for fault in order if fault in taken)


def other_cells() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield section and name of everything else that a bench can declare, and what each rig says: seen, or refused."""

    def cells(**settings: Any) -> tuple[str, ...]:
        return tuple("refused" if refused(rig, **settings) else "seen" for rig in RIGS)

    for kind in ROTOR_FAULTS:
        yield "faults.rotors", kind, cells(faults={"rotors": [rotor_entry(kind)]}, **rotor_settings(kind))
    for kind in SURFACE_FAULTS:
        yield "faults.surfaces", kind, cells(faults={"surfaces": [{"kind": kind, "surface": "elevator", "at_s": 1.0}]})
    for kind in LINK_FAULTS:
        yield "faults.links", kind, cells(faults={"links": [link_entry(kind)]})
    for message, direction in (("HIL_GPS", "to_autopilot"), ("ATTITUDE", "from_autopilot")):
        entry = link_entry("drop", messages=[message], direction=direction)
        yield "messages of faults.links", message, cells(faults={"links": [entry]})
    for name in OWN_FAULTS:
        yield "autopilot.faults", name, cells(autopilot={"faults": {name: 1.0}})
    for section, values in WORLD.items():
        for name, value in values.items():
            yield section, name, cells(**dict.fromkeys([section.partition(".")[0]], _nested(section, name, value)))
    for name, action in ACTIONS.items():
        yield "actions", name, tuple("refused" if refused_script(rig, action) else "seen" for rig in RIGS)
    for word in WORDS:
        said = tuple("refused" if refused_script(rig, {"set_mode": word}) else "seen" for rig in RIGS)
        yield "set_mode of actions", word, said


def _nested(section: str, name: str, value: Any) -> dict[str, Any]:
    inner = {name: value}
    return inner if "." not in section else {section.partition(".")[2]: inner}


def refused_script(rig: str, action: dict[str, Any], *, at_s: float = 1.0) -> list[str]:
    """Return the problems of a script with this action on a rig."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "script.yaml"
        path.write_text(yaml.safe_dump({"outcome": "any", "actions": [{"at_s": at_s, **action}]}))
        return refused(rig, mission=str(path))


def effect_table() -> str:
    """Return what each rig says of every other fault and mode."""
    rows = ["| declared | " + " | ".join(f"`{rig}`" for rig in RIGS) + " |", "|---" * (len(RIGS) + 1) + "|"]
    together: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for section, name, cells in other_cells():
        together.setdefault((section, cells), []).append(f"`{name}`")
    rows += [
        f"| {section}: {', '.join(names)} | " + " | ".join(cells) + " |" for (section, cells), names in together.items()
    ]
    return "\n".join(rows)


if __name__ == "__main__":
    print(sensor_table(), effect_table(), sep="\n\n")
