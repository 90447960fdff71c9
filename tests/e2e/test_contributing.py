"""The examples of CONTRIBUTING.md work as they stand there."""

from __future__ import annotations

import os
import re
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from firmware_bridge.transports.transport import Transport
from hil.config import load_bench
from hil.run.autopilots.surroundings import Surroundings, make_link
from hil.run.bench_run import run_bench
from sim.sensors.kinds import KINDS

TEXT = (Path(__file__).resolve().parents[2] / "CONTRIBUTING.md").read_text()
BLOCKS = re.findall(r"```(?:python|yaml)\n# (\S+)\n(.*?)```", TEXT, re.DOTALL)
SHORT = ["autopilot.transport=loopback", "record.tlog=false", "record.report=false"]


def module(path: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import the example of that path as a module."""
    (source,) = [source for name, source in BLOCKS if name == path]
    name = path.removesuffix(".py").replace("/", ".")
    made = types.ModuleType(name)
    monkeypatch.setitem(sys.modules, name, made)
    exec(compile(source, path, "exec"), made.__dict__)
    return made


def bench_after(heading: str, folder: Path) -> Path:
    """Write the bench file of the section with that heading."""
    section = TEXT.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    (bench,) = re.findall(r"```yaml\n(# bench\.yaml\n.*?)```", section, re.DOTALL)
    (folder / "bench.yaml").write_text(bench)
    return folder / "bench.yaml"


def test_a_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, "tachometer", module("sim/sensors/tachometer.py", monkeypatch).KIND)
    bench = load_bench(bench_after("Add a sensor", tmp_path), settings=[*SHORT, "duration_s=2"])
    result = run_bench(bench, tmp_path / "out", quiet=True)
    assert result.run["error"] is None
    assert result.run["sensors"]["tacho"]["samples"] == 100
    with (tmp_path / "out" / "run.mcap").open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/tacho"])
        values = [message.value for _, _, _, message in messages]
    assert len(values) == 100
    assert values[0] != 0.0


def test_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module("hil/run/parts/ceiling.py", monkeypatch)
    bench = load_bench(bench_after("Add a part", tmp_path), settings=[*SHORT, "duration_s=25", "record.mcap=false"])
    result = run_bench(bench, tmp_path / "out", quiet=True)
    assert result.run["error"] is None
    assert result.run["ceiling"]["above_s"] > 1.0
    assert any(reason.endswith("s above 8 m") for reason in result.run["verdict"]["reasons"])
    assert any(row["name"] == "above_ceiling_s" and not row["ok"] for row in result.run["verdict"]["rows"])


def test_an_autopilot_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module("hil/run/autopilots/other_hitl.py", monkeypatch)
    bench = load_bench(settings=SHORT)
    main, far = os.openpty()
    port = os.ttyname(far)
    autopilot = bench.config.autopilot.model_copy(update={"kind": "other_hitl", "port": port})
    bench = type(bench)(**vars(bench) | {"config": bench.config.model_copy(update={"autopilot": autopilot})})
    wrapped: list[Transport] = []

    def wrap(transport: Transport) -> Transport:
        wrapped.append(transport)
        return transport

    link = make_link(
        bench,
        Surroundings(tmp_path, wrap, lambda _kind, _text: None, lambda _kind, _text: None, (47.0, 8.0, 400.0, 0.0)),
    )
    assert link.caps.kind == "other_hitl"
    assert port in wrapped[0].name
    os.close(main)
    os.close(far)
