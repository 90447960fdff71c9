"""Every fault, effect and action that a bench can declare: on each rig it is seen where it must be, or refused.

The cells come from the registries (`tests.worlds.declared_effects`), so that a new sensor, field, fault, effect or
action fails here until something shows what it does. Seen means: in the messages that the autopilot gets, in ground
truth, in the messages of the autopilot, or as the named error of the run.
"""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

from firmware_bridge.autopilots.catalog import SENSOR_KINDS
from firmware_bridge.autopilots.installation import Surroundings
from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack
from firmware_bridge.faults.companion_fault import CompanionFault
from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.links.ardupilot import external_ahrs
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.transports.transport import Transport
from hil.config import load_bench
from hil.config.missions.script import ActionSpec
from hil.config.missions.script_file import _TARGETS
from hil.run.autopilot import installation_of
from hil.run.bench_run import RunResult, run_bench
from hil.run.companion.link_faults import CompanionFaults
from hil.run.loop.restartable_physics import make_physics
from hil.run.loop.stages import plan_stages
from hil.run.part import RunContext
from hil.run.parts.links import faults as faults_part
from hil.run.recorder.recorder import Recorder
from hil.run.sensors.frame_stages import is_wanted, make_frames, needs_frames, stage_specs
from hil.run.sensors.sensor_slots import SensorSlots
from sim.physics.forces.force import Effects
from sim.randomize.settings import FEATURES
from sim.scene.weather import Weather
from sim.scene.wind import Wind
from sim.sensors.catalog import KINDS
from tests.worlds import external_ahrs_board, fake_arducopter
from tests.worlds.bench_process import free_instance
from tests.worlds.declared_effects import (
    ACTIONS,
    LINK_FAULTS,
    MOTORS,
    OWN_FAULTS,
    QUIET,
    RIGS,
    ROTOR_FAULTS,
    SENSORS,
    WORLD,
    SensorCell,
    accepted_cells,
    bench_of,
    choices,
    effect_table,
    link_entry,
    refused,
    rotor_entry,
    rotor_settings,
    sensor_cells,
    sensor_table,
)
from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
FAKE_PX4 = ROOT / "tests/worlds/fake_px4_sitl.py"
HELD_S, PERIOD_S, FIRST_S = 0.3, 0.6, 1.0
LATE_S = 0.25  # a sample's latency: the effect of a fault comes that much later at most
HIL = frozenset(MSGID[name] for name in ("HIL_SENSOR", "HIL_GPS", "DISTANCE_SENSOR", "HIL_OPTICAL_FLOW", "ODOMETRY"))


def load(folder: Path, rig: str, **settings: Any) -> Any:
    path = folder / "bench.yaml"
    path.write_text(yaml.safe_dump(bench_of(rig, **settings), sort_keys=False))
    return load_bench(path)


class Wire:
    """The messages to and from the autopilot, and the samples, each by time [s]."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.sent: dict[float, Any] = {}
        self.heard: list[tuple[float, Any]] = []
        self.samples: dict[str, dict[float, Any]] = {}
        self._parser = FrameParser()
        monkeypatch.setattr(Recorder, "sent", lambda _, tick, t_ns, data: self._add(t_ns * 1e-9, data))
        monkeypatch.setattr(
            Recorder,
            "received",
            lambda _, tick, t_ns, frames: self.heard.extend((t_ns * 1e-9, unpack(frame)) for frame in frames),
        )
        monkeypatch.setattr(Recorder, "sample", self._sample)

    def _add(self, t_s: float, data: bytes) -> None:
        state = data.find(b'{"timestamp"')  # of ArduPilot's JSON link, after MAVLink
        mavlink, more = (data, []) if state < 0 else (data[:state], [data[state:]])
        frames = [frame for frame in self._parser.feed(mavlink) if frame.msgid in HIL]
        # The number of a frame counts all frames before it: only content is compared.
        self.sent[t_s] = [*((frame.msgid, frame.payload) for frame in frames), *more]

    def _sample(self, port: str, sample: Any) -> None:
        self.samples.setdefault(port, {})[sample.t_capture_ns * 1e-9] = sample


def schedule(cells: list[SensorCell]) -> tuple[dict[SensorCell, float], list[dict[str, Any]], float]:
    """Return when each fault begins [s], the faults one after the other, and when the last is over."""
    begins = {cell: FIRST_S + PERIOD_S * number for number, cell in enumerate(cells)}
    entries = [entry for cell, at_s in begins.items() for entry in cell.entries(at_s, at_s + HELD_S)]
    return begins, entries, FIRST_S + PERIOD_S * len(cells)


def check_seen(begins: dict[SensorCell, float], faulty: dict[float, Any], sound: dict[float, Any]) -> None:
    """Each fault changes what is sent while it holds, and nothing is changed while none does."""
    changed = sorted(t_s for t_s in faulty if t_s in sound and faulty[t_s] != sound[t_s])
    assert len(faulty) > 100
    unseen = [cell for cell, at_s in begins.items() if not any(at_s <= t <= at_s + HELD_S + LATE_S for t in changed)]
    assert unseen == []
    held = [(at_s, at_s + HELD_S + LATE_S) for at_s in begins.values()]
    assert [t for t in changed if not any(begin - 1e-6 <= t <= end for begin, end in held)] == []


def fly(bench: Any, out: Path, wire: Wire | None = None) -> RunResult:
    if wire is not None:
        wire.sent, wire.heard, wire.samples, wire._parser = {}, [], {}, FrameParser()
    return run_bench(bench, out, quiet=True)


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    return Wire(monkeypatch)


def flights(
    folder: Path, wire: Wire, rig: str, cells: list[SensorCell], **settings: Any
) -> tuple[dict[SensorCell, float], dict[float, Any], RunResult]:
    """Fly the faults one after the other, the vehicle at rest; return when they begin, and what was sent."""
    begins, entries, until_s = schedule(cells)
    bench = load(folder, rig, faults={"sensors": entries}, duration_s=until_s, **settings)
    result = fly(bench, folder / "faulty", wire)
    return begins, wire.sent, result


def sound(folder: Path, wire: Wire, cells: list[SensorCell], rig: str = "mock") -> dict[float, Any]:
    """Return what the autopilot gets of the same vehicle at rest without faults."""
    bench = load(folder, rig, duration_s=schedule(cells)[2], autopilot=started(rig, folder))
    fly(bench, folder / "sound", wire)
    return wire.sent


# -- faults of sensors -----------------------------------------------------------------------------------------------


def test_every_kind_of_sensor_is_in_the_table() -> None:
    assert set(SENSORS) == set(KINDS)


def test_every_fault_of_a_sensor_is_seen_by_the_mock(tmp_path: Path, wire: Wire) -> None:
    cells = list(accepted_cells("mock"))
    begins, faulty, result = flights(tmp_path, wire, "mock", cells, autopilot={"transport": "loopback"})
    assert result.run["error"] is None
    assert not [row for row in result.run["warnings"] if "had no effect" in row["text"]]
    check_seen(begins, faulty, sound(tmp_path, wire, cells))


def started(rig: str, folder: Path) -> dict[str, Any]:
    """Return the section `autopilot` of the mock or of a stand-in for the firmware."""
    if rig == "mock":
        return {"transport": "loopback"}
    if rig == "ardupilot_sitl":
        return {"start": True, "binary": str(fake_arducopter.install(folder))}
    (folder / "etc/init.d-posix/airframes").mkdir(parents=True, exist_ok=True)
    (folder / "etc/init.d-posix/rcS").write_text("#!/bin/sh\n")
    (folder / "etc/init.d-posix/airframes/10016_none_iris").write_text("")
    binary = folder / "bin/px4"
    binary.parent.mkdir(exist_ok=True)
    binary.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {shlex.quote(str(FAKE_PX4))} "$@"\n')
    binary.chmod(0o755)
    return {"start": True, "binary": str(binary), "instance": free_instance()}


def test_every_fault_of_a_sensor_is_seen_by_px4(tmp_path: Path, wire: Wire) -> None:
    cells = list(accepted_cells("px4_sitl"))
    begins, faulty, result = flights(tmp_path, wire, "px4_sitl", cells, autopilot=started("px4_sitl", tmp_path))
    assert result.run["error"] is None
    check_seen(begins, faulty, sound(tmp_path, wire, cells, "px4_sitl"))


def test_every_fault_of_a_sensor_is_seen_by_ardupilot(tmp_path: Path, wire: Wire) -> None:
    """In the state that it gets, or set as a parameter of its own simulation."""
    cells = list(accepted_cells("ardupilot_sitl"))
    autopilot = started("ardupilot_sitl", tmp_path)
    begins, faulty, result = flights(tmp_path, wire, "ardupilot_sitl", cells, autopilot=autopilot)
    assert result.run["error"] is None
    asked = json.loads((tmp_path / "faulty/autopilot/parameters.json").read_text())
    bench = load(tmp_path, "ardupilot_sitl", duration_s=schedule(cells)[2], autopilot=autopilot)
    fly(bench, tmp_path / "sound", wire)
    own = {
        cell: at_s
        for cell, at_s in begins.items()
        if cell.kind not in ("imu", "range_finder", "external_vision", "pitot", "vane")
    }
    check_seen({cell: at_s for cell, at_s in begins.items() if cell not in own}, faulty, wire.sent)
    set_s = [steps / 400 for what, _, _, steps in asked if what == "set"]
    assert [cell for cell, at_s in own.items() if not any(at_s <= t < at_s + HELD_S - 0.01 for t in set_s)] == []


def test_a_flow_sensor_without_range_finder_has_no_faults_of_its_distance() -> None:
    sensors = bench_of("px4_sitl")["sensors"] | {"flow": {"preset": "pmw3901", "rate_hz": 50}}
    entries = SensorCell("optical_flow", "offset", "distance_m").entries(1.0, 2.0)
    (said,) = refused("px4_sitl", sensors=sensors, faults={"sensors": entries})
    assert "field is 'distance_m', which 'flow' does not measure" in said


@pytest.mark.parametrize("rig", ["mock_hitl", "px4_hitl"])
@pytest.mark.slow
def test_every_fault_of_a_sensor_is_seen_on_a_free_running_link(
    tmp_path: Path, wire: Wire, rig: str, board: Callable[..., Any]
) -> None:
    cells = list(accepted_cells(rig))
    autopilot = {} if rig == "mock_hitl" else {"port": board().port}
    begins, faulty, result = flights(tmp_path, wire, rig, cells, autopilot=autopilot)
    assert result.run["error"] is None
    # As PX4's simulation gets it: of the mock in lockstep the temperature is not that of the air.
    check_seen(begins, faulty, sound(tmp_path, wire, cells, "px4_sitl"))


def test_every_fault_of_a_sensor_is_seen_by_an_external_ahrs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In its packets. The samples come from the bench's own sensors, with the faults that it declares."""
    monkeypatch.setattr(external_ahrs, "_BOOTED_BEFORE_S", 0.0)
    cells = list(accepted_cells("ardupilot_eahrs"))
    begins, entries, until_s = schedule(cells)

    def packets(faults: list[dict[str, Any]]) -> dict[float, Any]:
        bench = load(tmp_path, "ardupilot_eahrs", faults={"sensors": faults}, tick_hz=400)
        slots = slots_of(bench, tmp_path)
        far = external_ahrs_board.Bench(external_ahrs_board.Board())
        sent: dict[float, Any] = {}
        physics = make_physics(bench)
        for tick in range(round(until_s * 400)):
            truth = physics.advance(tick, (0.0,) * 4)
            names = {"imu": "imu", "mag": "magnetometer", "baro": "barometer", "gps": "gps"}
            samples = {key: slots[SENSORS[kind][0]](truth) for key, kind in names.items()}
            far.board.packets.clear()
            far.run(1, **samples)
            sent[truth.t_ns * 1e-9] = list(far.board.packets)
        return sent

    check_seen(begins, packets(entries), packets([]))


def slots_of(bench: Any, out: Path) -> dict[str, Callable[[Any], Any]]:
    """Return the sensors of a bench as functions that return the sample due at a truth, else None."""
    plan = plan_stages(stage_specs(bench.config))
    wanted = {name: sensor for name, sensor in bench.config.sensors.items() if is_wanted(name, sensor, plan)}
    recorder = Recorder(out, mcap=False, tlog=False, tick_ns=bench.config.tick_ns)
    frames = make_frames(bench) if needs_frames(bench.config) else None
    slots = SensorSlots(bench, wanted, plan, frames, recorder, out).slots

    def due(slot: Any) -> Callable[[Any], Any]:
        numbers = iter(range(1 << 30))
        return lambda truth: slot.sample(truth, next(numbers)) if slot.rate.due() else None

    return {slot.port: due(slot) for slot in slots}


def test_cameras_lidars_and_radars_freeze_and_drop_out(tmp_path: Path, wire: Wire) -> None:
    """They feed no autopilot; their samples go to companions and the recording."""
    kinds = [kind for kind in KINDS if kind not in SENSOR_KINDS]
    assert {cell.fault for cell in sensor_cells(kinds)} == {"freeze", "dropout"}
    sensors = bench_of("mock")["sensors"] | dict(SENSORS[kind] for kind in kinds)
    more = {"sensors": sensors, "duration_s": 1.0, "record": QUIET | {"mcap": True, "images": True}}
    more |= {"autopilot": {"transport": "loopback"}, "quality": "low"}
    seen = {}
    for name, faults in {
        "sound": [],
        "faulty": [entry for cell in sensor_cells(kinds) for entry in cell.entries(*_span(cell.fault))],
    }.items():
        fly(load(tmp_path, "mock", faults={"sensors": faults}, **more), tmp_path / name, wire)
        seen[name] = wire.samples
    for kind in kinds:
        sensor = SENSORS[kind][0]
        times = sorted(seen["sound"][sensor])
        dropped = [t for t in times if t not in seen["faulty"][sensor]]
        assert dropped == [t for t in times if 0.6 <= t < 0.8]
        assert dropped
        frozen = [str(seen["faulty"][sensor][t][3:]) for t in times if 0.15 <= t < 0.4]
        assert len(frozen) > 1
        assert len(set(frozen)) == 1


def _span(fault: str) -> tuple[float, float]:
    return (0.15, 0.4) if fault == "freeze" else (0.6, 0.8)


# -- faults of rotors, wind and the model ----------------------------------------------------------------------------

CLIMB, FALL = (0.9,) * 4, (0.35,) * 4


def track(bench: Any) -> list[Any]:
    """Return the ground truth of a climb and a fall, each tick."""
    physics = make_physics(bench)
    ticks = round(1e9 / bench.config.tick_ns)
    return [physics.advance(tick, CLIMB if tick < ticks else FALL) for tick in range(4 * ticks)]


def differ_s(truth: list[Any], other: list[Any]) -> float:
    """Return the first time at which the vehicle moves in another way [s]; infinity: it does not."""
    pairs = zip(truth, other, strict=True)
    return min((a.t_ns * 1e-9 for a, b in pairs if a.a_WB_W != b.a_WB_W or a.alpha_WB_B != b.alpha_WB_B), default=1e9)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    return track(load(tmp_path_factory.mktemp("calm"), "mock"))


@pytest.mark.parametrize("kind", ROTOR_FAULTS)
def test_every_fault_of_a_rotor_moves_the_vehicle(tmp_path: Path, calm: list[Any], kind: str) -> None:
    own = rotor_settings(kind)
    without = track(load(tmp_path, "mock", **own)) if own else calm
    faulty = track(load(tmp_path, "mock", faults={"rotors": [rotor_entry(kind, 0.5)]}, **own))
    assert 0.5 <= differ_s(faulty, without) < 0.6


@pytest.mark.parametrize("name", list(WORLD["wind"]))
def test_every_kind_of_wind_moves_the_vehicle(tmp_path: Path, calm: list[Any], name: str) -> None:
    assert set(WORLD["wind"]) == set(Wind.model_fields)
    windy = track(load(tmp_path, "mock", wind={name: WORLD["wind"][name]}))
    assert differ_s(windy, calm) < 1.0


@pytest.mark.parametrize("name", list(WORLD["physics.effects"]))
def test_every_effect_of_the_model_moves_the_vehicle(tmp_path: Path, calm: list[Any], name: str) -> None:
    assert set(WORLD["physics.effects"]) == set(Effects.model_fields)
    effects = {name: WORLD["physics.effects"][name]}
    # The vortex ring state is part of the inflow of blade elements: its switch is the simple model's.
    model = {"vehicle_settings": {"rotor_model": "quadratic"}} if name == "descent_loss" else {}
    without = track(load(tmp_path, "mock", **model)) if model else calm
    assert differ_s(track(load(tmp_path, "mock", physics={"effects": effects}, **model)), without) < 4.0


def test_the_world_is_the_same_for_every_autopilot(tmp_path: Path) -> None:
    """So what moves one vehicle moves them all; the rates of the ticks are made equal."""
    what = {"faults": {"rotors": [rotor_entry(kind, 0.5, number) for number, kind in enumerate(ROTOR_FAULTS)]}} | MOTORS
    what |= {"wind": WORLD["wind"], "physics": {"effects": WORLD["physics.effects"]}, "tick_hz": 100}
    tracks = {rig: track(load(tmp_path, rig, **what)) for rig in RIGS}
    assert all(other == tracks["mock"] for other in tracks.values())


def test_weather_and_random_features_change_the_scene(tmp_path: Path) -> None:
    assert set(WORLD["weather"]) == set(Weather.model_fields)
    assert set(WORLD["randomize"]) == set(FEATURES)
    clear = load(tmp_path, "mock", scene="city_park")
    for section in ("weather", "randomize"):
        for name, value in WORLD[section].items():
            bench = load(tmp_path, "mock", scene="city_park", **{section: {name: value}})
            if name == "noise":
                assert bench.sensor_parameters("imu") != clear.sensor_parameters("imu")
            else:
                assert bench.scene != clear.scene, (section, name)


# -- faults of links and of the autopilot ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", LINK_FAULTS)
def test_every_fault_of_the_link_changes_what_the_mock_gets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    got: list[bytes] = []
    at_ns: list[int] = []

    class Spied(MockPixhawk):
        def feed(self, data: bytes) -> bytes:
            got.append(data)
            at_ns.append(time.monotonic_ns())
            return super().feed(data)

    monkeypatch.setattr("firmware_bridge.mock_pixhawk.autopilot.MockPixhawk", Spied)

    def flown(*faults: dict[str, Any]) -> tuple[bytes, RunResult]:
        got.clear()
        at_ns.clear()
        settings = {"autopilot": {"transport": "loopback", "reply_timeout_s": PATIENCE_S}, "duration_s": 2.0}
        result = fly(load(tmp_path, "mock", faults={"links": list(faults)}, **settings), tmp_path / "out")
        return b"".join(got), result

    gps = {} if kind in ("stall", "unplug") else {"messages": ["HIL_GPS"], "direction": "to_autopilot"}
    sound, _ = flown()
    hit, result = flown(link_entry(kind, 1.0, 0.2, **gps) | ({"delay_s": 0.05} if kind == "delay" else {}))
    assert result.run["faults"]["links"][0]["hits"] > 0
    if kind == "unplug":
        assert result.run["error"]["type"] == "LinkClosed"
    elif kind in ("delay", "stall"):  # simulated time waits for the wire: the same bytes, later
        assert hit == sound
        assert max(later - earlier for earlier, later in pairwise(at_ns)) > 0.04e9
    else:
        assert hit != sound


@pytest.mark.parametrize("rig", RIGS)
def test_faults_act_on_the_link_of_every_rig_or_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rig: str
) -> None:
    faults = {"links": [link_entry(kind) for kind in LINK_FAULTS]}
    if says := refused(rig, faults=faults):
        assert "bench.yaml" in says[0]
        assert rig == "ardupilot_sitl"
        return
    bench = load(tmp_path, rig, faults=faults)
    wrapped: list[Transport] = []

    def wrap(transport: Transport) -> Transport:
        wrapped.append(transport)
        return transport

    monkeypatch.setattr("firmware_bridge.devices.serial_path.serial_path", lambda port: port)
    installation = installation_of(bench, make_physics(bench).state)
    bench.config.autopilot.profile.make_link(
        installation, Surroundings(tmp_path, wrap, lambda *_: None, lambda *_: None)
    )
    assert len(wrapped) == 1
    part = faults_part.make(bench)
    part.open(RunContext(bench, tmp_path, []))
    monkeypatch.setattr(RunContext, "recorder", Recorder(tmp_path, mcap=False, tlog=False, tick_ns=1), raising=False)
    assert isinstance(part.wrap_link(wrapped[0]), FaultyTransport)


@pytest.mark.parametrize("direction", ["to_autopilot", "from_autopilot", "both"])
def test_messages_that_the_line_does_not_carry_are_refused(tmp_path: Path, direction: str) -> None:
    both = {
        "PARAM_VALUE": {"px4_sitl"},
        "HIL_SENSOR": {"ardupilot_eahrs"},
        "HIL_ACTUATOR_CONTROLS": {"ardupilot_eahrs"},
    }
    wrong_way = {"to_autopilot": "HIL_ACTUATOR_CONTROLS", "from_autopilot": "HIL_SENSOR"}.get(direction)
    for message, without in both.items():
        for rig in RIGS:
            if rig == "ardupilot_sitl":
                continue
            says = refused(rig, faults={"links": [link_entry("drop", messages=[message], direction=direction)]})
            assert bool(says) == (rig in without or message == wrong_way), (rig, message, says)
            assert not says or f"names {message}, which the line of {rig} does not carry" in says[0]


@pytest.mark.parametrize("name", OWN_FAULTS)
def test_every_fault_of_the_mock_itself_is_seen(tmp_path: Path, name: str) -> None:
    autopilot = {"transport": "loopback", "faults": {name: 1.0}, "reply_timeout_s": PATIENCE_S}
    run = fly(load(tmp_path, "mock", autopilot=autopilot, duration_s=2.0), tmp_path / "out").run
    if name == "noise_at_s":
        assert run["error"] is None
        assert run["autopilot"]["link"]["garbage_bytes"] > 1000
        return
    assert run["error"]["type"] == ("LinkClosed" if name == "die_at_s" else "LockstepLost")
    assert run["sim_s"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("name", OWN_FAULTS)
@pytest.mark.slow
def test_every_fault_of_the_free_running_mock_is_seen_or_refused(tmp_path: Path, name: str) -> None:
    if refused("mock_hitl", autopilot={"faults": {name: 1.0}}):
        assert name == "wrong_time_at_s"
        return
    bench = load(tmp_path, "mock_hitl", autopilot={"faults": {name: 1.5}, "reply_timeout_s": 1.5}, duration_s=4.0)
    run = fly(bench, tmp_path / "out").run
    garbage = run["autopilot"]["link"]["garbage_bytes"] > 1000
    silent = any("the actuator commands stopped" in row["text"] for row in run["warnings"])
    assert {"die_at_s": run["error"] is not None, "stall_at_s": silent or run["error"] is not None}.get(name, garbage)


def test_every_fault_of_a_companions_link_is_seen() -> None:
    seen, unplugged = set(), []
    faults = CompanionFaults(1, lambda *_: None, lambda client, _: unplugged.append(client), wall_ns=lambda: 0)
    for kind in choices(CompanionFault, "kind"):
        more = {"drop": {"rate": 1.0}, "delay": {"delay_s": 0.5}}.get(kind, {})
        faults.inject(CompanionFault(kind=kind, client=kind, at_s=0.0, for_s=1.0, **more), 0)
        if faults.lose(kind, 1) or faults.delayed(kind, 5) > 5 or faults.unplugged(kind):
            seen.add(kind)
    assert seen == set(choices(CompanionFault, "kind"))
    assert unplugged == ["unplug"]


# -- actions of a script ---------------------------------------------------------------------------------------------

SCRIPT = """
outcome: any
actions:
  - {at_s: 3, param: {MIS_TAKEOFF_ALT: 4.0}}
  - {at_s: 4.4, set_mode: TAKEOFF}
  - {at_s: 4.5, arm: true}
  - {at_s: 7, command: {id: 178, params: [1, 3, -1]}}
  - {after: takeoff, delay_s: 2, gust: {speed_mps: 4, direction_deg: 270, for_s: 1}}
  - {after: takeoff, delay_s: 2, fault: {sensor: gps, kind: dropout, for_s: 1}}
  - {after: takeoff, delay_s: 3, fault: {rotor: 1, kind: efficiency, factor: 0.95}}
  - {at_s: 8, fault: {link: {kind: drop, rate: 1.0, for_s: 1.5, messages: [HIL_GPS]}}}
  - {at_s: 9, fault: {autopilot: noise}}
  - {after: takeoff, delay_s: 6, set_mode: LAND}
limits: {max_cross_track_m: null, final_error_m: null, altitude_error_m: null}
"""


def test_every_action_has_a_row() -> None:
    kinds = {name.partition(":")[0] for name in ACTIONS}
    assert kinds == set(ActionSpec.model_fields) - {"at_s", "after", "delay_s", "required"}
    assert {name.partition(": ")[2] for name in ACTIONS} - {""} == set(_TARGETS)
    for name, action in ACTIONS.items():
        assert set(action) == {name.partition(":")[0]}


def test_every_action_is_seen_by_the_mock(tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(Recorder, "event", lambda _, t_ns, kind, text: told.append(text))
    (tmp_path / "script.yaml").write_text(SCRIPT)
    settings = {"mission": str(tmp_path / "script.yaml"), "duration_s": 60, "failsafe": {"required": False}}
    result = fly(load(tmp_path, "mock", autopilot={"transport": "loopback"}, **settings), tmp_path / "out", wire)
    check_actions(wire, result, told, parameter="MIS_TAKEOFF_ALT")
    assert result.run["faults"]["links"][0]["hits"] > 0
    assert result.run["autopilot"]["link"]["garbage_bytes"] > 1000
    assert "gps: dropout began" in told
    assert "rotor 1: efficiency falls to 95 %" in told
    assert any(text.startswith("gust of (4, 0, 0) m/s") for text in told)


def check_actions(wire: Wire, result: RunResult, told: list[str], *, parameter: str) -> None:
    """The autopilot's own messages show the mode, the arming, the parameter and the command."""
    assert result.run["error"] is None, result.run["error"]
    assert {row["outcome"] for row in result.run["actions"]} == {"done"}
    heard = [message for _, message in wire.heard]
    beats = [message for message in heard if type(message).__name__.upper() == "HEARTBEAT"]
    assert len({beat.custom_mode for beat in beats}) > 1
    assert {beat.base_mode & 0x80 for beat in beats} == {0, 0x80}
    assert any(getattr(message, "param_id", "") == parameter and message.param_value == 4.0 for message in heard)
    assert any(getattr(message, "command", 0) == 178 and message.result == 0 for message in heard)


def test_every_action_is_seen_by_px4(tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(Recorder, "event", lambda _, t_ns, kind, text: told.append(text))
    script = "\n".join(line for line in SCRIPT.splitlines() if "autopilot" not in line)
    (tmp_path / "script.yaml").write_text(script)
    settings = {"mission": str(tmp_path / "script.yaml"), "duration_s": 60, "failsafe": {"required": False}}
    bench = load(tmp_path, "px4_sitl", autopilot=started("px4_sitl", tmp_path), vehicle="iris", **settings)
    check_actions(wire, fly(bench, tmp_path / "out", wire), told, parameter="MIS_TAKEOFF_ALT")


def test_a_misspelt_parameter_of_a_script_is_told_before_take_off(tmp_path: Path) -> None:
    """By the check where the parameters are known, else before the vehicle may arm; both with status 2."""
    (tmp_path / "script.yaml").write_text("outcome: any\nactions:\n  - {at_s: 1, param: {MPC_XY_CRUSE: 3}}\n")
    mission = str(tmp_path / "script.yaml")
    (said,) = refused("mock", mission=mission)
    assert "script.yaml:3: actions[0].param.MPC_XY_CRUSE is unknown to the mock autopilot" in said
    assert "did you mean 'MPC_XY_CRUISE'?" in said
    bench = load(tmp_path, "px4_sitl", autopilot=started("px4_sitl", tmp_path), mission=mission, duration_s=30)
    result = fly(bench, tmp_path / "out")
    assert result.exit_status == 2
    assert (
        "script.yaml:3: actions[0].param.MPC_XY_CRUSE: is unknown to PX4 (did you mean 'MPC_XY_CRUISE'?)"
        in (result.run["error"]["message"])
    )


def test_a_flight_that_did_not_meet_its_faults_fails(tmp_path: Path) -> None:
    faults = {
        "rotors": [rotor_entry("stuck", 5.0)],
        "sensors": [
            {"kind": "dropout", "sensor": "gps", "at_s": 1.01, "until_s": 1.05},
            {"kind": "dropout", "sensor": "spare", "at_s": 1.0},
            {"kind": "dropout", "sensor": "gps", "at_s": 1.5},
        ],
        "links": [link_entry("drop", messages=["PARAM_SET"]), link_entry("duplicate", messages=["HIL_GPS"])],
    }
    spare = {"spare": {"kind": "gps", "preset": "here_plus", "rate_hz": 5, "autopilot": False}}
    settings = {"autopilot": {"transport": "loopback"}, "duration_s": 3.0, "faults": faults}
    bench = load(tmp_path, "mock", sensors=bench_of("mock")["sensors"] | spare, **settings)
    run = fly(bench, tmp_path / "out").run
    unread = "fault of spare: dropout at 1 s had no effect: it was not sampled: nothing reads it"
    assert [text for text in run["verdict"]["reasons"] if text.startswith("fault of")] == [
        text for text in run["unmet"] if text != unread
    ]
    assert run["unmet"] == [
        "fault of rotor 0: stuck at 5 s never began: the flight ended at 3 s",
        "fault of spare: dropout at 1 s had no effect: it was not sampled: nothing reads it",
        "fault of gps: dropout at 1.01 s had no effect: no sample fell into its time",
        "fault of the link: drop of PARAM_SET at 1 s had no effect: no such message passed",
    ]


def test_faults_of_a_mock_that_the_user_starts_are_refused() -> None:
    (said,) = refused("mock", autopilot={"port": "/dev/ttyS9", "faults": {"die_at_s": 1.0}})
    assert "the bench does not start the mock on /dev/ttyS9" in said


# -- the page --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("table", [sensor_table, effect_table])
def test_the_page_has_the_table(table: Callable[[], str]) -> None:
    """`python -m tests.worlds.declared_effects` prints both."""
    assert table() in (ROOT / "docs/faults.md").read_text()
