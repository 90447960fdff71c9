"""Kinds of autopilot in a bench file: every rig loads; settings that do not fit the kind are named with their line."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest
from typer.testing import CliRunner

from firmware_bridge.autopilots.catalog import PROFILES
from hil.cli.app import app
from hil.config import load_bench
from hil.config.files import available
from hil.config.schema import Autopilot
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)

RIGS = available("rig", ())
KINDS = get_args(Autopilot.model_fields["kind"].annotation)


def needs(rig: str) -> list[str]:
    """Return the settings without which the rig, named as its kind, does not load with the default bench."""
    profile = PROFILES[rig]
    without = [] if profile.mavlink else ["mission=null"]
    return [*without, "autopilot.start=false"] if profile.is_program else without


def test_each_kind_has_its_rig() -> None:
    assert {load("", rig=rig, settings=needs(rig)).config.autopilot.kind for rig in RIGS} == set(KINDS)


@pytest.mark.parametrize("rig", RIGS)
def test_each_rig_loads_with_the_default_bench(rig: str) -> None:
    bench = load_bench(rig=rig, settings=needs(rig))
    assert bench.config.rig == rig
    assert (bench.mission is not None) == PROFILES[rig].mavlink
    assert bench.config.description
    assert bench.vehicle.rotors
    assert bench.config.pace == (None if bench.config.autopilot.lockstep else 1.0)


@pytest.mark.parametrize("rig", RIGS)
def test_hil_check_names_what_each_rig_needs(rig: str) -> None:
    """From an empty folder."""

    def check(*settings: str) -> tuple[int, str]:
        options = [word for setting in settings for word in ("--set", setting)]
        done = CliRunner().invoke(app, ["check", "--rig", rig, *options])
        return done.exit_code, " ".join(done.output.split())

    if PROFILES[rig].is_program:
        status, said = check()
        assert status == 2
        assert f"{rig}.yaml:" in said
        assert "autopilot.binary must name your own build of the firmware" in said
        assert "--set autopilot.start=false" in said
    status, said = check(*needs(rig))
    assert status == 0, said
    assert f"ok: rig {rig}," in said


HEAD = "rig: {rig}\nautopilot:\n  boot_sensors: 0\n"  # the line under test is line 4
OTHER = "(leave it out or choose another rig)"


@pytest.mark.parametrize(
    ("rig", "line", "says"),
    [
        ("mock", "  binary: px4", f"autopilot.binary has no meaning for mock {OTHER}"),
        ("mock_hitl", "  env: {A: b}", f"autopilot.env has no meaning for mock_hitl {OTHER}"),
        ("mock_hitl", "  start: false", "autopilot.start is false, but autopilot.port is not set"),
        ("mock_hitl", "  airframe: x499",
         "autopilot.airframe is unknown to the mock autopilot: 'x499' (known: iris, plane, standard_vtol, x500)"),
        ("mock_hitl", "  params: {MPC_XY_PP: 1}",
         "autopilot.params.MPC_XY_PP is unknown to the mock autopilot (did you mean 'MPC_XY_P'?)"),
        ("mock_hitl", "  transport: loopback",
         f"autopilot.transport has no meaning for mock_hitl {OTHER}"),
        ("px4_hitl", "  faults: {die_at_s: 1}",
         "autopilot.faults has no meaning for px4_hitl (see faults.links for faults of any link)"),
        ("px4_hitl", "  binary: px4", f"autopilot.binary has no meaning for px4_hitl {OTHER}"),
        ("px4_hitl", "  on_restart: reset", f"autopilot.on_restart has no meaning for px4_hitl {OTHER}"),
        (
            "px4_sitl",
            "  binary: no/such/px4",
            "autopilot.binary names a program that does not exist: no/such/px4 "
            "(`make px4_sitl` in PX4-Autopilot makes build/px4_sitl_default/bin/px4)",
        ),
        ("px4_sitl", "  {start: false, port: /dev/ttyACM0}",
         f"autopilot.port has no meaning for px4_sitl {OTHER}"),
        ("px4_sitl", "  {start: false, params: {MPC_XY_P: 1}}",
         "autopilot.params has no effect: the bench does not start the autopilot (autopilot.start is false) "
         "(give it to the program that you start)"),
        ("ardupilot_sitl", "  {start: false, env: {A: b}}",
         f"autopilot.env has no meaning for ardupilot_sitl {OTHER}"),
    ],
)  # fmt: skip
def test_settings_that_do_not_fit_the_kind_are_named_with_their_line(rig: str, line: str, says: str) -> None:
    if line.lstrip().startswith("{"):
        text = f"rig: {rig}\n\n\nautopilot: {line.strip()}\n"
    else:
        text = HEAD.format(rig=rig) + line + "\n"
    assert f"b.yaml:4: {says}" in refused(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rig: mock_hitl\npace: 2\n",
         "b.yaml:2: pace must be 1 or null, not 2: a free-running autopilot keeps wall-clock time"),
        ("rig: ardupilot_sitl\nautopilot: {start: false}\nfaults:\n  links:\n    - {kind: drop, at_s: 1, rate: 1}\n",
         "b.yaml:4: faults.links cannot be applied to ardupilot_sitl (see faults.sensors and faults.rotors)"),
    ],
)  # fmt: skip
def test_settings_that_do_not_fit_the_rest_of_the_bench(text: str, says: str) -> None:
    assert says in refused(text)


def test_settings_that_fit_the_kind() -> None:
    Path("px4").write_text("#!/bin/sh\n")
    Path("px4").chmod(0o755)
    text = (
        "rig: px4_sitl\nautopilot: {binary: px4, params: {ANY_NAME: 3}, env: {A: b}, arguments: [-x], airframe: '1'}\n"
    )
    assert load(text).config.autopilot.params == {"ANY_NAME": 3.0}
    assert load("rig: ardupilot_sitl\nautopilot: {start: false, mavlink_port: 'udp:14550', on_restart: reset}\n")
    assert (
        load("rig: px4_hitl\npace: null\nautopilot: {port: /dev/ttyACM0, params: {MPC_XY_P: 1}}\n").config.pace is None
    )
    assert load("rig: mock_hitl\nautopilot: {port: /dev/ttyUSB0, start: false}\n")
    assert load("rig: mock_hitl\nfaults: {links: [{kind: drop, at_s: 1, rate: 0.1}]}\n").config.faults.links
    assert load("rig: mock\nautopilot: {transport: loopback}\n")


def test_names_of_environment_variables_are_checked() -> None:
    (found,) = refused("rig: px4_sitl\nautopilot:\n  start: false\n  env: {'A=B': c}\n")[:1]
    assert found == "b.yaml:4: autopilot.env: 'A=B' cannot be an environment variable"
