"""Foxglove follows a run live: a client of its protocol gets the recording's messages, holds the run and alters it."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import InvalidStatus

from hil.apps.dash.part import DashboardPart
from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.recorder.reading import Recording
from tests.worlds.bench_process import ROOT, free_port
from tests.worlds.dashboard_page import PageThread
from tests.worlds.foxglove_client import FoxgloveClient, connected, wire_fields
from tests.worlds.patience import PATIENCE_S

pytest.importorskip("foxglove", reason="needs Foxglove's SDK: pip install 'hil-bench[foxglove]'")

SENSORS = """
  front: {kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [rgb, depth]}
  down: {kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [rgb]}
  lidar: {preset: vlp16, rate_hz: 5}
"""
BENCH = """
scene: airfield
mission: rigs/missions/rectangle.plan
autopilot: {transport: loopback}
duration_s: 4
crash: null
record: {report: false, tlog: false}
sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
"""
Script = Callable[[FoxgloveClient], None]


def flown(
    folder: Path,
    *settings: str,
    text: str = BENCH,
    script: Script | None = None,
    wanted: Any = None,
    quiet: bool = True,
) -> tuple[dict[str, Any], FoxgloveClient | None]:
    """Fly a bench; with a script, a client subscribes before the first tick and the script then resumes the run."""
    folder.mkdir(exist_ok=True)
    file = folder / "bench.yaml"
    file.write_text(text.replace("rigs/", f"{ROOT}/rigs/"))
    clients: list[FoxgloveClient] = []
    failures: list[BaseException] = []
    port = free_port()

    def follow(act: Script) -> None:
        client = connected(port, *(() if wanted is None else (wanted,)))
        clients.append(client)
        client.until(lambda: client.messages["/map/plan"] or (client.time_ns == 0 and client.channels))
        time.sleep(0.3)
        try:
            act(client)
        except BaseException as failure:  # noqa: BLE001 (raised by the test's thread)
            failures.append(failure)
            client.set("paused", False)

    live = [] if script is None else [f"foxglove.port={port}", "foxglove.paused=true"]
    thread = None if script is None else threading.Thread(target=follow, args=(script,), daemon=True)
    if thread is not None:
        thread.start()
    run = run_bench(load_bench(file, settings=[*live, *settings]), folder / "out", quiet=quiet).run
    if thread is not None:
        thread.join(PATIENCE_S)
        assert clients[0].join()
    if failures:
        raise failures[0]
    return run, clients[0] if clients else None


def resume(client: FoxgloveClient) -> None:
    client.set("paused", False)


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], FoxgloveClient, Path]:
    folder = tmp_path_factory.mktemp("watched")
    run, client = flown(folder, "pace=2", text=BENCH + SENSORS, script=resume)
    assert client is not None
    return run, client, folder / "out"


def test_a_client_that_watches_changes_nothing(watched: Any, tmp_path: Path) -> None:
    run, client, _ = watched
    alone, _ = flown(tmp_path / "alone", text=BENCH + SENSORS)
    assert run["digest"] == alone["digest"]
    assert (run["status"], run["error"]) == (alone["status"], alone["error"])
    assert [command["what"] for command in run["by_hand"]] == ["resume"]
    assert run["deterministic"] is True
    assert client.status[-1]["message"] == "the flight is over"


def test_the_topics_and_bytes_are_those_of_the_recording(watched: Any) -> None:
    _, client, out = watched
    recorded: dict[str, set[bytes]] = {}
    types: dict[str, tuple[str, str]] = {}
    for message in Recording(out / "run.mcap").scan().messages():
        recorded.setdefault(message.topic, set()).add(bytes(message.data))
    for topic, schema in topics_of(out / "run.mcap").items():
        types[topic] = schema
    live = {topic for topic, channel in client.channels.items() if channel["encoding"] == "cdr"}
    assert set(types) <= live
    extra = {"/truth/odometry", "/front/rgb/compressed", "/down/rgb/compressed"}
    assert live - set(types) == extra
    for topic, (name, text) in types.items():
        channel = client.channels[topic]
        assert (channel["schemaName"], channel["schema"], channel["schemaEncoding"]) == (name, text, "ros2msg")
        if topic != "/events":  # of tick 0, which no client's run shares with another's
            assert client.counts[topic] > 0, topic
            # The stamp of a mount is that of the first frame sent, which a busy machine may have left out.
            start = 16 if topic == "/tf_static" else 0
            same = {data[start:] for data in recorded[topic]}
            for _, data in client.messages[topic]:
                assert data[start:] in same, topic


def test_a_web_page_cannot_alter_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    attempts: list[int] = []

    def attack(client: FoxgloveClient) -> None:
        for origin, host in (("https://evil.example", "127.0.0.1"), ("null", "localhost"), (None, "evil.example")):
            with pytest.raises(InvalidStatus) as refused:
                FoxgloveClient(client.port, origin=origin, host=host).set("wind.steady_mps", [9.0, 0.0, 0.0])
            attempts.append(refused.value.response.status_code)
        FoxgloveClient(client.port, origin="https://app.foxglove.dev", host="localhost").set("paused", False)

    run, _ = flown(tmp_path / "attacked", script=attack, quiet=False)
    alone, _ = flown(tmp_path / "alone")
    assert attempts == [403, 403, 403]
    assert run["digest"] == alone["digest"]
    assert [command["what"] for command in run["by_hand"]] == ["resume"]
    shown = capsys.readouterr().out
    assert "foxglove: a page of 'https://evil.example' was refused: no requests from pages of other sites" in shown
    assert "foxglove.origins names the pages that may connect" in shown


def topics_of(path: Path) -> dict[str, tuple[str, str]]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = summary.schemas
    return {
        channel.topic: (schemas[channel.schema_id].name, schemas[channel.schema_id].data.decode())
        for channel in summary.channels.values()
        if summary.statistics is not None and summary.statistics.channel_message_counts.get(channel.id)
    }


def test_another_library_decodes_every_message(watched: Any) -> None:
    _, client, _ = watched
    store = get_typestore(Stores.EMPTY)
    for topic, channel in client.channels.items():
        if channel["encoding"] != "cdr":
            continue
        name = channel["schemaName"]
        store.register({k: v for k, v in get_types_from_msg(channel["schema"], name).items() if k not in store.types})
        for _, data in client.messages[topic][-5:]:
            store.deserialize_cdr(data, name)
    picture = store.deserialize_cdr(client.messages["/front/rgb/compressed"][-1][1], "sensor_msgs/msg/CompressedImage")
    raw = store.deserialize_cdr(client.messages["/front/rgb"][-1][1], "sensor_msgs/msg/Image")
    assert (picture.header.stamp, picture.header.frame_id) == (raw.header.stamp, raw.header.frame_id)
    decoded = cv2.cvtColor(cv2.imdecode(picture.data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB).astype(float)
    assert np.abs(decoded - raw.data.reshape(decoded.shape)).mean() < 8.0
    cloud = store.deserialize_cdr(client.messages["/lidar"][-1][1], "sensor_msgs/msg/PointCloud2")
    assert cloud.width * cloud.point_step == len(cloud.data) > 0


def test_the_map_and_the_scene_show_the_flight(watched: Any) -> None:
    _, client, _ = watched
    assert {client.channels[t]["schemaName"] for t in ("/scene", "/map/position", "/map/plan")} == {
        "foxglove.SceneUpdate", "foxglove.LocationFix", "foxglove.GeoJSON",
    }  # fmt: skip
    plan = json.loads(wire_fields(client.messages["/map/plan"][0][1])[1][0])
    corners = plan["features"][0]["geometry"]["coordinates"]
    fix = wire_fields(client.messages["/map/position"][-1][1])
    assert abs(fix[1][0] - corners[0][1]) < 1e-4
    assert abs(fix[2][0] - corners[0][0]) < 1e-4
    entities = [wire_fields(entity) for entity in wire_fields(client.messages["/scene"][0][1])[2]]
    assert [entity[3][0].decode() for entity in entities] == ["scene", "drone", "plan"]
    model = wire_fields(entities[0][14][0])
    ground = trimesh.load(BytesIO(model[7][0]), file_type="glb", force="mesh")
    assert model[6] == [b"model/gltf-binary"]
    assert np.ptp(ground.vertices, axis=0)[1] < 1e-6  # level: y is up in glTF
    assert len(entities[1][10]) == 4  # rotors


def test_pause_step_parameters_and_faults(tmp_path: Path) -> None:
    seen: dict[str, Any] = {}

    def script(client: FoxgloveClient) -> None:
        at = client.call("/hil/pause")["tick"]
        seen["steps"] = [client.call("/hil/step")["tick"] - at for _ in range(3)]
        client.set("wind.steady_mps", [1.0, 0.0, 0.0])
        client.set("wind.turbulence_mps", 3.0)
        client.set("pace", 50.0)
        assert client.until(lambda: client.parameters.get("pace") == 50.0)
        refused = [("pace", "NaN"), ("pace", -1.0), ("pace", 1e9), ("wind.steady_mps", [1.0, 2.0]), ("none", 1.0)]
        refused += [("wind.steady_mps", [99.0, 0.0, 0.0]), ("wind.turbulence_mps", -0.1), ("paused", 3.0)]
        refused += [("wind.steady_mps", "NaN"), ("wind.turbulence_mps", True)]
        for name, value in refused:
            client.set(name, value)
        client.say(op="setParameters", parameters=[{"name": "pace", "value": "NaN", "type": "float64"}])
        assert client.until(lambda: len(client.status) >= len(refused) + 1)
        seen["refused"] = [status["message"] for status in client.status]
        client.ask_parameters()
        seen["fault"] = client.call("/hil/inject", {"rotor": 0, "kind": "efficiency", "factor": 0.9})
        seen["no fault"] = client.call("/hil/inject", {"rotor": 77, "kind": "efficiency", "factor": 0.9})
        seen["no vehicle"] = client.call("/hil/inject", {"rotor": 0, "kind": "stop", "vehicle": "zorro"})
        seen["nonsense"] = client.call("/hil/pause", {"x": 1})
        client.playback_control(0)
        assert client.until(lambda: client.parameters["paused"] is False)

    run, client = flown(tmp_path, script=script)
    assert client is not None
    assert seen["steps"] == [0, 1, 2]  # the tick that a step begins with
    assert "pace must be from 0 to 1000 times real time; 0: as fast as it goes, not -1.0" in str(seen["refused"])
    assert "wind.steady_mps must be three numbers (east, north, up) [m/s]" in str(seen["refused"])
    assert client.parameters["wind.steady_mps"] == [1.0, 0.0, 0.0]
    assert isinstance(seen["fault"]["tick"], int)
    assert "rotor" in seen["no fault"]
    assert "no vehicle of this run is named 'zorro'" in seen["no vehicle"]
    assert "takes no x" in seen["nonsense"]
    done = [command["what"] for command in run["by_hand"]]
    assert done[:3] == ["step one tick"] * 3
    assert done[3:] == [
        "wind by hand: 1, 0, 0 m/s (east, north, up)",
        "turbulence by hand: 3 m/s of wind at 20 ft",
        "pace: 50 times real time",
        "fault: rotor 0: efficiency falls to 90 %",
        "resume",
    ]
    assert run["deterministic"] is False
    assert client.playback[-1][0] == 3  # ended
    assert client.server["dataEndTime"] == {"sec": 4, "nsec": 0}


def test_a_client_that_reads_nothing_stops_neither_the_run_nor_the_others(tmp_path: Path) -> None:
    stuck: list[socket.socket] = []

    def script(client: FoxgloveClient) -> None:
        port = client._socket.remote_address[1]
        slow = socket.create_connection(("127.0.0.1", port))
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        rows = [{"id": c["id"], "channelId": c["id"]} for c in client.channels.values()]
        text = json.dumps({"op": "subscribe", "subscriptions": rows}).encode()
        mask = b"\0\0\0\0"
        slow.sendall(struct.pack(">BBH", 0x81, 0x80 | 126, len(text)) + mask + text)
        stuck.append(slow)
        time.sleep(0.2)
        resume(client)

    run, client = flown(tmp_path, text=BENCH + SENSORS, script=script)
    assert client is not None
    assert run["error"] is None
    assert run["sim_s"] == 4.0
    assert client.counts["/lidar"] > 0
    stuck[0].close()


@pytest.mark.slow
def test_clients_of_a_server_without_control_only_watch(tmp_path: Path) -> None:
    def script(client: FoxgloveClient) -> None:
        assert client.until(lambda: client.messages["/truth/pose"])
        assert not client.services
        client.set("pace", 1.0)
        assert client.until(lambda: client.status)

    run, client = flown(
        tmp_path, "foxglove.control=false", "foxglove.paused=false", "duration_s=6", "pace=4", script=script
    )
    assert client is not None
    assert client.server["capabilities"] == ["time"]
    assert run["deterministic"] is True
    assert "by_hand" not in run


def test_a_paused_run_with_a_dashboard_waits_for_its_page_too(tmp_path: Path) -> None:
    def script(page: PageThread, state: dict[str, Any]) -> None:
        if state["paused"]:
            page.say(kind="resume")

    (tmp_path / "bench.yaml").write_text(BENCH.replace("rigs/", f"{ROOT}/rigs/"))
    page = PageThread(on_state=script)
    live = page.live()
    bench = load_bench(tmp_path / "bench.yaml", settings=["foxglove={port: 0, paused: true}", "duration_s=0.2"])
    try:
        run = run_bench(bench, tmp_path / "out", quiet=True, more=lambda name: [DashboardPart(live, name)]).run
    finally:
        live.close()
        page.join()
    assert run["error"] is None
    assert (page.states[0]["tick"], page.states[0]["paused"]) == (0, True)


@pytest.mark.slow
def test_a_bench_with_a_pace_shows_that_it_goes_as_fast_as_it_can_once_asked_to(tmp_path: Path) -> None:
    def script(client: FoxgloveClient) -> None:
        client.ask_parameters()
        assert client.until(lambda: client.parameters.get("pace") == 2.0)
        client.set("pace", 0.0)
        client.call("/hil/step")  # the run has carried out both and told what is
        time.sleep(0.2)
        client.ask_parameters()
        time.sleep(0.2)
        shown.append(client.parameters["pace"])
        resume(client)

    shown: list[float] = []
    flown(tmp_path, "pace=2", script=script)
    assert shown == [0.0]


def test_vehicles_share_one_server(tmp_path: Path) -> None:
    text = BENCH + "vehicles: {a: {start: {p_W: [0, 0, 0]}}, b: {start: {p_W: [5, 0, 0]}}}\n"

    def script(client: FoxgloveClient) -> None:
        seen["fault"] = client.call("/hil/inject", {"rotor": 1, "kind": "efficiency", "factor": 0.9, "vehicle": "b"})
        resume(client)

    seen: dict[str, Any] = {}
    run, client = flown(tmp_path, "pace=4", text=text, script=script)  # as fast as it can, a busy link leaves all out
    assert client is not None
    topics = set(client.channels)
    assert {"/a/imu", "/b/imu", "/tf", "/a/map/position", "/b/map/position", "/a/events", "/b/events"} <= topics
    assert client.counts["/a/truth/pose"] > 0
    assert client.counts["/b/truth/pose"] > 0
    assert [row["what"].split(":")[0] for row in run["by_hand"] if row["alters"]] == ["b"]
    assert run["deterministic"] is False


def test_the_address_is_printed_once_for_all_vehicles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = BENCH.replace("rigs/", f"{ROOT}/rigs/") + "vehicles: {a: {}, b: {start: {p_W: [5, 0, 0]}}}\n"
    (tmp_path / "bench.yaml").write_text(text)
    bench = load_bench(tmp_path / "bench.yaml", settings=["foxglove.port=0", "duration_s=0.2"])
    run_bench(bench, tmp_path / "out")
    assert capsys.readouterr().out.count("foxglove: open ws://127.0.0.1:") == 1


def command(folder: Path, *settings: str) -> list[str]:
    words = [sys.executable, "-m", "hil.cli", "run", "--quiet", "--out", str(folder)]
    return words + [word for setting in (*settings, "record.report=false") for word in ("--set", setting)]


def failed(folder: Path, status: int, *settings: str) -> str:
    """Return what a run that ends with this status says on standard error."""
    words = command(folder, *settings)
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr


def error_of(folder: Path, *settings: str) -> str:
    failed(folder, 3, *settings)
    return str(json.loads((folder / "run.json").read_text())["error"]["message"])


@pytest.mark.slow
def test_a_busy_port_and_an_address_of_another_machine_are_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
        assert error_of(tmp_path / "a", f"foxglove.port={port}") == (
            f"127.0.0.1:{port}: Foxglove's server cannot listen there: another program does; set foxglove.port"
        )
    text = error_of(tmp_path / "b", "foxglove.port=0", "foxglove.host=192.0.2.7")
    assert text.startswith("192.0.2.7:0: Foxglove's server cannot listen there (")
    assert "foxglove.host" in failed(tmp_path / "c", 2, "foxglove.port=0", "foxglove.host=example")
    assert "nobody could resume" in failed(tmp_path / "c", 2, "foxglove.paused=true", "foxglove.control=false")
    assert not (tmp_path / "c").exists()  # nothing began


def test_an_interrupt_ends_a_paused_run_and_frees_the_port(tmp_path: Path) -> None:
    port = free_port()
    words = command(tmp_path, f"foxglove.port={port}", "foxglove.paused=true")
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=os.environ)
    client = connected(port)
    assert client.until(lambda: "/truth/pose" in client.channels)
    process.send_signal(signal.SIGINT)
    process.wait(PATIENCE_S)
    assert client.join()
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["error"]["type"] == "Interrupted"
    with socket.create_server(("127.0.0.1", port)):
        pass


def test_a_run_without_the_section_imports_nothing_of_it(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from hil.config import load_bench; "
        "from hil.run.bench_run import run_bench; "
        "bench = load_bench(None, settings=['duration_s=0.1', 'record.report=false', 'autopilot.transport=loopback']); "
        f"run_bench(bench, Path({str(tmp_path)!r}), quiet=True); "
        "assert not [name for name in sys.modules if 'foxglove' in name], sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True, timeout=PATIENCE_S)
