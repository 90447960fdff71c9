"""Signing in whole runs: pymavlink clients with and without the key, and the bench's own ground station."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from pymavlink import mavutil

from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.codecs.signing import SigningKey, is_signed, matches
from hil.run_files import TLOG_NAME
from tests.worlds.bench_process import BenchProcess, free_port
from tests.worlds.patience import until

PHRASE = "correct horse"
KEY = hashlib.sha256(PHRASE.encode()).digest()


def key_file(folder: Path) -> Path:
    path = folder / "signing.key"
    path.write_text(PHRASE + "\n")
    path.chmod(0o600)
    return path


def test_only_clients_with_the_key_command_the_vehicle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")  # pymavlink begins with MAVLink 1 otherwise, which has no signatures
    port = free_port()
    settings = ["mission=null", "pace=5", "duration_s=3000", f"router.sdk=udpin:127.0.0.1:{port}"]
    settings.append(f"router.signing_key_file={key_file(tmp_path)}")
    stranger = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=240, dialect="all")
    friend = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=241, dialect="all")
    friend.setup_signing(KEY)
    with BenchProcess(tmp_path, *settings) as bench:

        def heard(kind: str) -> object:
            stranger.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
            friend.mav.heartbeat_send(6, 8, 0, 0, 4)
            return friend.recv_match(type=kind, blocking=True, timeout=0.5)

        until(lambda: heard("ATTITUDE"), "telemetry")
        assert not friend.motors_armed()

        def armed() -> bool:
            friend.arducopter_arm()
            ack = friend.recv_match(type="COMMAND_ACK", blocking=True, timeout=1)
            return ack is not None and ack.result == 0

        until(armed, "arming")
        friend.arducopter_disarm()
        run = bench.finish()
    assert run["error"] is None
    assert run["router"]["unsigned"] > 0
    assert run["router"]["clients"] == 1
    assert friend.mav.signing.badsig_count == 0
    assert stranger.recv_match(blocking=False) is None
    friend.close(), stranger.close()


def test_the_benchs_ground_station_signs(tmp_path: Path) -> None:
    settings = ["duration_s=4", "autopilot.transport=loopback"]
    settings.append(f"autopilot.signing_key_file={key_file(tmp_path)}")
    with BenchProcess(tmp_path, *settings) as bench:
        run = bench.finish()
    assert run["error"] is None
    assert run["deterministic"] is False  # a signature holds the time of day
    frames = FrameParser().feed((tmp_path / TLOG_NAME).read_bytes())
    said = [frame for frame in frames if frame.sysid == 255]
    assert len(said) > 5
    assert all(is_signed(frame.raw) and matches(SigningKey(KEY), frame.raw) for frame in said)
