"""Flights of a taildragger from and to a runway: in calm air, across the wind, and with an engine that fails."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from hil.run.bench_run import RunResult
from tests.worlds.bench_files import flown

ROOT = Path(__file__).resolve().parents[2]
BENCH = (ROOT / "rigs/benches/runway.yaml").read_text().replace("record: {mcap: true, tlog: true, report: true}", "")
QUIET = "autopilot: {transport: loopback}\nrecord: {mcap: false, tlog: false, report: false}\n"


def fly(tmp_path: Path, more: str = "", *, text: str = BENCH) -> RunResult:
    return flown(tmp_path, text + QUIET + more)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_circuit_in_a_light_cross_wind(tmp_path: Path, seed: int) -> None:
    text = BENCH.replace("seed: 1", f"seed: {seed}")
    result = fly(tmp_path, "wind: {steady_W_mps: [-1, 2, 0], turbulence: {wind_20ft_mps: 2}}\n", text=text)
    assert result.status == "PASS", result.run["verdict"]
    flown = result.run["mission"]
    assert flown["centre_line_m"] < 3.0
    assert flown["off_runway_m"] == 0.0
    assert flown["touchdown_sink_mps"] < 1.5
    assert flown["takeoff_roll_m"] < 15.0
    assert 30.0 < flown["landing_roll_m"] < 100.0


@pytest.mark.slow
def test_without_brakes_it_rolls_further(tmp_path: Path) -> None:
    """The wheels' own 0.02 and the drag of the air alone."""
    trainer = (ROOT / "rigs/vehicles/trainer.yaml").read_text().replace("brakes: 0.12", "brakes: 0.0")
    (tmp_path / "free.yaml").write_text(trainer)
    result = fly(tmp_path, text=BENCH.replace("vehicle: trainer", f"vehicle: {tmp_path / 'free.yaml'}"))
    assert result.run["mission"]["landing_roll_m"] > 110.0


@pytest.mark.parametrize(
    ("at_s", "named", "lands"),
    [
        pytest.param(6.3, "engine failed, takeoff aborted", False, id="slow, on the roll"),
        pytest.param(7.3, "engine failed, takeoff aborted", False, id="fast, on the roll"),
        pytest.param(9.0, "engine failure, gliding", True, id="4 m over the runway"),
    ],
)
def test_an_engine_that_fails_at_take_off_is_named(tmp_path: Path, at_s: float, named: str, lands: bool) -> None:
    fault = f"faults: {{rotors: [{{kind: efficiency, rotor: 0, at_s: {at_s}, factor: 0}}]}}\n"
    result = fly(tmp_path, fault)
    assert result.status == "FAIL"
    reasons = " ".join(result.run["verdict"]["reasons"])
    assert named in reasons
    assert "rotor 0 efficiency falls to 0 %" in reasons
    flown = result.run["mission"]
    assert flown["off_runway_m"] == 0.0
    assert flown["centre_line_m"] < 5.0
    assert flown["landed"] == lands
    if lands:
        assert flown["touchdown_sink_mps"] < 2.0
        assert flown["landing_roll_m"] < 100.0


LAUNCHES = {
    "hand": "{kind: hand, speed_mps: 14, at_s: 12}",
    "catapult": "{kind: catapult, length_m: 4, speed_mps: 16, at_s: 12}",
    "bungee": "{kind: bungee, stiffness_npm: 22, stretch_m: 6, at_s: 12}",
}


@pytest.mark.parametrize("kind", LAUNCHES)
def test_a_launch_is_detected_and_the_engine_stands_until_then(tmp_path: Path, kind: str) -> None:
    plane = (ROOT / "rigs/plane.yaml").read_text().replace("duration_s: 400", "duration_s: 20")
    plane = plane.replace("{kind: catapult, length_m: 4, speed_mps: 16}", LAUNCHES[kind])
    params = "autopilot: {transport: loopback, params: {FW_LAUN_DETCN_ON: 1, FW_LAUN_MOT_DEL: 0.2}}\n"
    record = params + "record: {tlog: false, report: false}"
    flown(tmp_path, plane.replace("record: {mcap: true, tlog: true, report: true}", record))
    speeds: dict[float, float] = {}
    detected_s = released_s = 0.0
    (log,) = (tmp_path / "out").glob("*.mcap")
    with log.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, raw, message in reader.iter_decoded_messages(topics=["/truth/rotors", "/events"]):
            if channel.topic == "/truth/rotors":
                speeds[raw.log_time * 1e-9] = max(message.speed_radps)
            elif "Launch detected" in message.msg:
                detected_s = raw.log_time * 1e-9
            elif "released" in message.msg:
                released_s = raw.log_time * 1e-9
    assert 12.05 <= detected_s < released_s + 0.1  # FW_LAUN_AC_T after the pull began
    assert max(speed for t, speed in speeds.items() if t < detected_s + 0.2) < 1.0
    assert max(speed for t, speed in speeds.items() if t < detected_s + 1.5) > 300.0
