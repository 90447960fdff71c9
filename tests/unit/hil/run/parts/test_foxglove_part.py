"""Pieces of the live Foxglove server: its model file, thinned ticks, missing package, turbulence set by hand."""

from __future__ import annotations

import sys
from io import BytesIO
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.config import load_bench
from hil.run.loop.by_hand import HandControl, HandledVehicle, Refused
from hil.run.parts.links.foxglove.boxes import BOXES, BoxView
from hil.run.parts.links.foxglove.commands import _parameter_command
from hil.run.parts.links.foxglove.feed import _SENT_TICKS, Tick, _selected
from hil.run.parts.links.foxglove.glb import glb
from hil.run.parts.links.foxglove.server import installed_sdk
from signals.errors import ConfigError
from sim.frame.scene_mesh import Piece
from sim.scene.wind import Turbulence, Wind, WindAtVehicle


def test_the_model_has_the_triangles_upright_and_coloured() -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 5]], np.float32)
    pieces = [
        Piece(5.0, corners, np.array([255, 0, 0, 255], np.uint8)),
        Piece(5.0, corners + 10, np.array([188, 188, 188, 255], np.uint8)),
    ]
    data = glb(pieces)
    import trimesh  # here, as every process that collects tests imports the rest

    mesh = trimesh.load(BytesIO(data), file_type="glb", force="mesh", process=False)
    x, y, z = mesh.vertices.T  # glTF: y up
    assert np.allclose(np.stack((x, -z, y), axis=1), np.vstack((corners, corners + 10)))
    assert len(mesh.faces) == 2
    colour = np.frombuffer(data[-6 * 8 :], "<u2").reshape(6, 4) / 65535.0  # the last view of the file
    assert colour[0].tolist() == [1.0, 0.0, 0.0, 1.0]
    assert np.allclose(colour[3], [0.5, 0.5, 0.5, 1.0], atol=0.01)  # sRGB 188 is half of the light


def _tick(tick: int, **samples: int) -> Any:
    return Tick(SimpleNamespace(tick=tick), tuple(samples.items()), None, None)  # type: ignore[arg-type]


def test_ticks_of_a_fast_run_are_thinned_and_no_newest_sample_is_lost() -> None:
    few = [_tick(k) for k in range(_SENT_TICKS)]
    assert _selected(few) == few
    assert _selected([]) == []
    many = [_tick(k, imu=k, **({"gps": k} if k % 25 == 0 else {})) for k in range(3, 378)]
    kept = _selected(many)
    assert 10 < len(kept) <= _SENT_TICKS + 1
    assert kept[-1].truth.tick == 377
    assert all(tick.truth.tick % 10 == 0 for tick in kept[:-1])  # `/tf` has a message in every tenth tick
    assert [dict(tick.released)["imu"] for tick in kept] == [tick.truth.tick for tick in kept]
    gps = [value for tick in kept for port, value in tick.released if port == "gps"]
    assert gps == list(range(25, 378, 25))


def test_a_missing_package_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ConfigError, match=r"needs the package foxglove-sdk.*pip install 'hil-bench\[foxglove\]'"):
        installed_sdk()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1, True, "1", None, [1.0], 0.001, 1001, 10**400])
def test_paces_that_are_refused(value: Any) -> None:
    with pytest.raises(Refused, match="pace must be"):
        _parameter_command("pace", value)


@pytest.mark.parametrize("value", [[float("nan"), 0, 0], [0, 0], [0, 0, 31], "abc", b"abc", 3.0, None, [0, 0, True]])
def test_winds_that_are_refused(value: Any) -> None:
    with pytest.raises(Refused, match=r"wind.steady_mps must be"):
        _parameter_command("wind.steady_mps", value)


def test_an_autopilot_that_cannot_be_held_cannot_begin_paused() -> None:
    settings = ["foxglove={port: 0, paused: true}"]
    assert load_bench(None, rig="mock", settings=settings).config.foxglove.paused
    with pytest.raises(ConfigError, match=r"foxglove.paused is true, and this autopilot runs on wall-clock time"):
        load_bench(None, rig="mock_hitl", settings=settings)


def test_a_refusal_repeats_no_long_value() -> None:
    for name, value in (("pace", "x" * 10**6), ("wind.steady_mps", [1.0] * 10**5), ("x" * 10**6, 0.0)):
        with pytest.raises(Refused) as refused:
            _parameter_command(name, value)
        assert len(str(refused.value)) < 200


def _deviation(wind: WindAtVehicle, first: int, ticks: int) -> float:
    return float(np.std([wind.at(k, 30.0, (0.0, 0.0, 0.0))[2] for k in range(first, first + ticks)]))


def test_turbulence_by_hand_has_the_strength_of_turbulence_from_the_start() -> None:
    tick_ns = 20_000_000
    declared = WindAtVehicle(Wind(turbulence=Turbulence(wind_20ft_mps=6.0)), seed=3, tick_ns=tick_ns)
    declared.start(30.0)
    expected = _deviation(declared, 1, 20_000)
    assert abs(expected - 0.6) < 0.25  # sigma_w = 0.1 W20
    calm = WindAtVehicle(Wind(), seed=3, tick_ns=tick_ns)
    calm.start(30.0)
    assert calm.constant
    assert calm.at(1, 30.0, (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    calm.set_turbulence(6.0, 1)
    assert abs(calm.at(2, 30.0, (0.0, 0.0, 0.0))[2]) < 0.05  # rises over a second
    for k in range(3, 60):
        calm.at(k, 30.0, (0.0, 0.0, 0.0))
    assert abs(_deviation(calm, 60, 20_000) / expected - 1.0) < 0.15
    calm.set_turbulence(0.0, 20_060)
    for k in range(20_060, 20_120):
        calm.at(k, 30.0, (0.0, 0.0, 0.0))
    assert calm.at(20_120, 30.0, (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


def test_a_command_takes_over_the_pace_of_the_bench() -> None:
    scheduler = SimpleNamespace(tick=5, tick_ns=4_000_000, t_ns=20_000_000, paces=[2.0])
    scheduler.take_pace = lambda: scheduler.paces.pop() if scheduler.paces else None
    vehicle = HandledVehicle("")
    events: list[Any] = []
    vehicle._access = SimpleNamespace(scheduler=scheduler, lockstep=True, event=lambda *e: events.append(e))  # type: ignore[assignment]
    clock = [0]
    control = HandControl({"": vehicle}, clock_ns=lambda: clock[0])
    control.serving = vehicle
    assert not control.holds
    assert not control.paces
    control.carry_out("pause", {}, vehicle)
    assert (control.paused, control.pace) == (True, 2.0)
    polls: list[int] = []

    def wait(limit_s: float) -> None:
        clock[0] += round(limit_s * 1e9)

    def poll() -> None:
        polls.append(clock[0])
        if len(polls) == 50:
            control.carry_out("resume", {}, vehicle)

    control.hold(wait, poll, lambda: False)
    assert vehicle.paused_s == pytest.approx(1.0)
    began = clock[0]
    for _ in range(10):  # no burst after the pause: two milliseconds a tick
        scheduler.tick += 1
        control.hold(wait, lambda: None, lambda: False)
    assert (clock[0] - began) * 1e-6 == pytest.approx(20.0)
    assert [what["what"] for what in vehicle.commands] == ["pause", "resume"]
    assert len(events) == 2
    control.carry_out("pace", {"pace": None}, vehicle)
    assert (control.paces, control.pace) == (True, None)


def test_a_fault_with_numbers_too_large_is_refused_and_not_an_error_of_the_run() -> None:
    scheduler = SimpleNamespace(tick=5, tick_ns=4_000_000, t_ns=20_000_000)
    vehicle = HandledVehicle("")
    vehicle._access = SimpleNamespace(scheduler=scheduler, inject=lambda fault: None, event=lambda *e: None)  # type: ignore[assignment]
    control = HandControl({"": vehicle})
    control.serving = vehicle
    for fault in ({"sensor": "gps", "kind": "dropout"}, {"link": "autopilot", "kind": "unplug"}):
        with pytest.raises(Refused, match="too large"):
            control.carry_out("inject", {"fault": fault | {"for_s": 10**400}}, vehicle)
    with pytest.raises(Refused, match="for_s"):  # a fault of a rotor has no end
        control.carry_out("inject", {"fault": {"rotor": 0, "kind": "stuck", "for_s": 5}}, vehicle)
    assert not vehicle.commands


class _Messages:
    """Stands for the SDK's messages: each is what it was made of."""

    LinePrimitiveLineType = SimpleNamespace(LineList=2)

    def __getattr__(self, name: str) -> Any:
        return lambda **fields: SimpleNamespace(kind=name, **fields)


def test_boxes_of_people_move_with_them() -> None:
    bench = load_bench(None, scene="city_park", settings=["mission=null"])
    sent: list[Any] = []
    server: Any = SimpleNamespace(
        sdk=SimpleNamespace(messages=_Messages()),
        declare_typed=lambda topic, message: sent.append((topic, message)),
        log=lambda topic, message, t_ns: sent.append((topic, message.entities, t_ns)),
    )
    view = BoxView(server, bench.world)
    assert sent == [(BOXES, "SceneUpdate")]
    for t_ns in (0, 2_000_000_000):
        view.update(t_ns)
    (_, before, _), (_, after, _) = sent[1:]
    assert [entity.id for entity in before] == [entity.id for entity in after]
    assert {actor.name for actor in bench.world.map.actors} == {entity.id for entity in before}
    moved = 0
    for old, new in zip(before, after, strict=True):
        assert {text.text for text in old.texts} <= {"person", "vehicle", "bicycle"}
        points = [np.array([(p.x, p.y, p.z) for p in entity.lines[0].points]) for entity in (old, new)]
        assert points[0].shape == (26, 3)  # twelve edges, and a line to the front
        lengths = np.linalg.norm(np.diff(points[0].reshape(13, 2, 3), axis=1), axis=2).ravel()
        assert np.allclose(np.sort(lengths[:12]).reshape(3, 4), np.sort(lengths[:12]).reshape(3, 4)[:, :1])
        moved += float(np.abs(points[0] - points[1]).max()) > 0.5
    assert moved > 3
