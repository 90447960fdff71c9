"""Files of parameters as ground stations save them, `autopilot.params_file`."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import load_bench
from hil.config.params_file import read_params_file
from hil.config.saved import save_bench
from hil.run.autopilot import installation_of
from hil.run.loop.restartable_physics import make_physics
from signals.errors import ConfigError

QGROUNDCONTROL = """# Onboard parameters for Vehicle 1
# Vehicle-Id Component-Id Name Value Type
1\t1\tMPC_XY_CRUISE\t3.000000000000000000\t9
1\t1\tCAL_ACC0_ID\t1310988\t6
1\t1\tSYS_AUTOSTART\t4001\t6
1\t1\tMY_DRIVER\t1\t6
1\t154\tCAM_MODE\t1\t6
"""


def params_file(folder: Path, text: str, name: str = "vehicle.params") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_the_formats_of_both_ground_stations(tmp_path: Path) -> None:
    read = read_params_file(params_file(tmp_path, QGROUNDCONTROL))
    assert [(p.name, p.value) for p in read] == [
        ("MPC_XY_CRUISE", 3.0), ("CAL_ACC0_ID", 1310988.0), ("SYS_AUTOSTART", 4001.0), ("MY_DRIVER", 1.0),
    ]  # fmt: skip
    assert read[0].where.endswith("vehicle.params:3")
    read = read_params_file(params_file(tmp_path, "WPNAV_SPEED,500\nATC_RAT_RLL_P 0.135 # tuned\n"))
    assert [(p.name, p.value) for p in read] == [("WPNAV_SPEED", 500.0), ("ATC_RAT_RLL_P", 0.135)]


def test_every_wrong_line_is_told(tmp_path: Path) -> None:
    text = "1 1 MPC_XY_CRUISE\nmpc_x 3\nMPC_XY_CRUISE fast\nMPC_XY_P nan\nMPC_Z_P 1\nMPC_Z_P 2\n1 1 A 1 9\n2 1 B 1 9\n"
    with pytest.raises(ConfigError) as caught:
        read_params_file(params_file(tmp_path, text))
    lines = str(caught.value).splitlines()
    expected = ("is not a parameter", "'mpc_x' cannot be", "not 'fast'", "not 'nan'", "second time", "several vehicles")
    assert len(lines) == len(expected)
    for line, part in zip(lines, expected, strict=True):
        assert "vehicle.params" in line
        assert part in line


def test_a_bench_flies_with_the_file_and_its_own_parameters_go_over_it(tmp_path: Path) -> None:
    params_file(tmp_path, QGROUNDCONTROL)
    file = tmp_path / "bench.yaml"
    file.write_text("autopilot: {params_file: vehicle.params, params: {MPC_Z_P: 0.9}}\n")
    bench = load_bench(file)
    autopilot = bench.config.autopilot
    # What belongs to the board it was saved from is left out.
    assert autopilot.all_params == {"MPC_XY_CRUISE": 3.0, "MY_DRIVER": 1.0, "MPC_Z_P": 0.9}
    saved = load_bench(save_bench(bench, tmp_path / "run"))  # without the file
    assert saved.config.autopilot == autopilot
    file.write_text("autopilot: {params_file: vehicle.params, params: {MPC_XY_CRUISE: 4}}\n")
    assert load_bench(file).config.autopilot.all_params["MPC_XY_CRUISE"] == 4.0
    # The mock has no parameter MY_DRIVER, and gets none.
    from firmware_bridge.autopilots.mock.mock import airframe_and_params

    bench = load_bench(file)
    assert airframe_and_params(installation_of(bench, make_physics(bench).state))[1] == ["MPC_XY_CRUISE=4.0"]


@pytest.mark.parametrize(
    ("rig", "text", "told"),
    [
        ("mock", "MPC_XY_CRUISE 9999", "vehicle.params:1: autopilot.params_of_file.MPC_XY_CRUISE cannot be 9999"),
        ("px4_hitl", "MPC_XY_CRUISE 3", "autopilot.params_file has no meaning for px4_hitl"),
        ("mock", None, "names a file that does not exist: vehicle.params"),
    ],
)
def test_a_file_that_does_not_fit(rig: str, text: str | None, told: str, tmp_path: Path) -> None:
    if text is not None:
        params_file(tmp_path, text)
    (tmp_path / "bench.yaml").write_text(f"rig: {rig}\nautopilot: {{params_file: vehicle.params}}\n")
    with pytest.raises(ConfigError) as caught:
        load_bench(tmp_path / "bench.yaml")
    assert told in str(caught.value)


def test_the_shipped_example_is_taken_whole() -> None:
    autopilot = load_bench("rigs/benches/params_file.yaml").config.autopilot
    assert len(autopilot.params_of_file) == 6
