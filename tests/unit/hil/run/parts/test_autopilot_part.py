"""Processors of bench and firmware."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from firmware_bridge.links.autopilot_link import LinkCaps
from hil.config import load_bench
from hil.run.parts.links import autopilot
from hil.run.parts.links.autopilot import AutopilotPart

PAIR = "rig: mock\nmission: rigs/missions/rectangle.plan\nvehicles: {a: {}, b: {start: {p_W: [5, 0, 0]}}}\n"


class Pinned(Exception):
    pass


def test_firmware_of_one_vehicle_is_pinned_and_that_of_several_uses_all_processors(tmp_path, monkeypatch):
    def pin(*_: object, **__: object) -> None:
        raise Pinned

    def fly(bench) -> None:
        part = AutopilotPart(bench)
        caps = LinkCaps("px4_sitl", lockstep=True, deterministic=False, boot_sensors=None, busy_processors=2)
        part._link, part._run = SimpleNamespace(caps=caps, pid=1), SimpleNamespace()
        with part.around_flight():
            pass

    monkeypatch.setattr(autopilot, "LockstepProcessors", pin)
    with pytest.raises(Pinned):
        fly(load_bench())
    (tmp_path / "pair.yaml").write_text(PAIR)
    fly(load_bench(tmp_path / "pair.yaml").vehicles["b"])
