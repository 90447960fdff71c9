"""`hil check` of the file of a campaign."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.cli.app import run_command_line

GOOD = """
settings: {rig: mock, wind: {steady_W_mps: [0, 0, 0]}}
axes: {scene: [airfield, city_park]}
samples: 10
sampled: {"wind.steady_W_mps.0": {uniform: [-3, 3]}}
"""


def check(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    path = tmp_path / "campaign.yaml"
    path.write_text(text)
    status = run_command_line(["check", str(path), *options])
    printed = capsys.readouterr()
    return status, printed.out + printed.err


def test_a_campaign_is_recognised_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed = check(tmp_path, GOOD, capsys)
    assert (status, printed) == (0, "ok: campaign of 20 points, axes scene, wind.steady_W_mps.0\n")


@pytest.mark.parametrize("text", ["bench: null\nsettings: {rig: mock}\n", "settings: {rig: mock}\n"])
def test_a_campaign_without_axes_is_one(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was read as a bench, whose unknown keys were told."""
    assert check(tmp_path, text, capsys) == (0, "ok: campaign of 1 point, axes none\n")


def test_a_slip_in_a_bench_makes_no_campaign_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed = check(tmp_path, "vehicle: x500\nsettings: {mass_kg: 2}\n", capsys)
    assert status == 2
    assert "did you mean 'vehicle_settings'?" in printed


def test_flights_that_would_wait_for_a_client_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = GOOD.replace("rig: mock", "rig: mock, foxglove: {port: 8765, paused: true}")
    status, printed = check(tmp_path, text, capsys)
    assert status == 2
    assert "foxglove.paused: is true: each flight would wait for a client" in printed


def test_every_problem_has_its_file_and_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axes = "axes:\n  scene: [airfield, city_parc]\n  seed: [1, -1]\n"
    status, printed = check(tmp_path, GOOD.replace("axes: {scene: [airfield, city_park]}\n", axes), capsys)
    assert status == 2
    scene, seed = printed.splitlines()
    assert "campaign.yaml:4: scene = 'city_parc': " in scene
    assert "campaign.yaml:5: seed = -1: " in seed


def test_an_unknown_axis_is_told_once_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axes = "axes:\n  scene: [airfield, city_park]\n  wnd: [1, 2, 3]\n"
    status, printed = check(tmp_path, GOOD.replace("axes: {scene: [airfield, city_park]}\n", axes), capsys)
    assert status == 2
    (line,) = printed.splitlines()
    assert "campaign.yaml:5: --set wnd: unknown key (did you mean 'wind'?)" in line


@pytest.mark.parametrize("name", ["n" * 300, "nowhere.yaml", "~nobody-of-that-name/b.yaml"])
def test_a_bench_that_there_is_not_is_told_with_its_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The place stood twice before the message, and the name of 300 bytes was a defect of the bench."""
    status, printed = check(tmp_path, f"bench: {name}\n{GOOD}", capsys)
    assert status == 2
    assert printed.startswith(f"error: {tmp_path}/campaign.yaml:1: bench names no file: {name} ")


def test_a_mistake_in_the_file_itself_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed = check(tmp_path, GOOD.replace("uniform: [-3, 3]", "uniform: [3, -3]"), capsys)
    assert status == 2
    assert "campaign.yaml:5: " in printed
    assert "the first value, 3, must not be above the second, -3" in printed


def test_options_of_a_bench_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed = check(tmp_path, GOOD, capsys, "--rig", "mock")
    assert status == 2
    assert "is a campaign: --rig, --scene, --mission and --set belong to a bench" in printed
