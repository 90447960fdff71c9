"""The dashboard's server over the network, without a browser: `hil run --dash`, `hil dash`, and access to them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hil.apps.dash.server.app import PAGE_FOLDER
from tests.worlds.bench_process import Hil
from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def dash(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hil]:
    hil = Hil(tmp_path_factory.mktemp("dash"), "dash", "--port", "0")
    yield hil
    hil.end()
    assert hil.process.returncode == 0


def test_all_files_of_the_page_are_served(dash: Hil) -> None:
    assert dash.get("/").status == 200
    for file in PAGE_FOLDER.rglob("*.*"):
        assert dash.get(f"/page/{file.relative_to(PAGE_FOLDER).as_posix()}").status == 200
    lists = json.loads(dash.get("/api/choices").read())
    assert "mock" in lists["rig"]
    assert int.from_bytes(dash.get("/api/scene").read()[:4], "little") > 0
    assert dash.get("/page/..%2f..%2fapp.py").status == 404
    assert dash.get("/runs/..%2f..%2fetc/passwd").status == 404


def test_requests_of_other_sites_are_refused(dash: Hil) -> None:
    assert dash.get("/api/runs", Origin="http://evil.example").status == 403
    assert dash.get("/", Host="evil.example").status == 403
    with pytest.raises(InvalidStatus):
        connect(f"ws://{dash.host}/live", open_timeout=PATIENCE_S, origin="http://evil.example").__enter__()  # type: ignore[arg-type]


def test_invalid_messages_do_not_stop_the_server(dash: Hil) -> None:
    nonsense = [
        "",
        "[" * 10_000,
        '{"kind": 7}',
        '{"kind": "start", "rig": {"a": 1}}',
        '{"kind": "reset"}',
        '{"kind": "streams", "streams": "view/camera/rgb"}',
        "x" * 20_000,
    ]
    with connect(f"ws://{dash.host}/live", open_timeout=PATIENCE_S) as page:
        for word in nonsense:
            page.send(word)
        page.send('{"kind": "next"}')
        assert b'"kind":"update"' in page.recv(PATIENCE_S)  # type: ignore[operator]
    with connect(f"ws://{dash.host}/live", open_timeout=PATIENCE_S) as page:
        page.send(b"\x00\x01")
    assert dash.get("/").status == 200


def test_a_run_is_started_stepped_reset_and_stopped(dash: Hil) -> None:
    with connect(f"ws://{dash.host}/live", open_timeout=PATIENCE_S) as page:

        def until(holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
            for _ in range(2000):
                page.send('{"kind": "next"}')
                data = page.recv(PATIENCE_S)
                assert isinstance(data, bytes)
                update: dict[str, Any] = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
                if holds(update):
                    return update
            raise AssertionError(update)

        page.send('{"kind": "start", "seed": 5, "paused": true}')
        first = until(lambda update: update.get("run") == 1)
        assert first["about"]["seed"] == 5
        until(lambda update: update["state"].get("paused") is True and update["state"]["tick"] == 0)
        page.send('{"kind": "step"}')
        until(lambda update: update["state"].get("tick") == 1)
        page.send('{"kind": "reset"}')
        second = until(lambda update: update.get("run") == 2)
        assert second["about"]["seed"] == 5
        assert second["about"]["out"] != first["about"]["out"]
        until(lambda update: update["state"].get("paused") is True and update["state"]["tick"] == 0)
        page.send('{"kind": "stop"}')
        ended = until(lambda update: update["result"] is not None)
        assert ended["result"]["error"]["type"] == "Interrupted"
    names = [run["name"] for run in json.loads(dash.get("/api/runs").read())]
    assert len(names) == 2


def test_a_page_follows_a_run(tmp_path: Path) -> None:
    hil = Hil(tmp_path, "run", "--quiet", "--dash", "--dash-port", "0", "--seed", "9")
    ended = threading.Event()

    def follow() -> None:
        with connect(f"ws://{hil.host}/live", open_timeout=PATIENCE_S) as page:
            page.send('{"kind": "next"}')
            while True:
                data = page.recv(PATIENCE_S)
                assert isinstance(data, bytes)
                update = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
                if update["result"] is not None:
                    assert update["result"]["seed"] == 9
                    ended.set()
                    return
                page.send('{"kind": "next"}')

    watcher = threading.Thread(target=follow, daemon=True)
    watcher.start()
    out, error = hil.process.communicate(timeout=PATIENCE_S)
    watcher.join(PATIENCE_S)
    assert ended.is_set()
    assert hil.process.returncode == 0, error
    assert "PASS" in out
    run = json.loads((tmp_path / "runs" / "latest" / "run.json").read_text())
    assert run["deterministic"] is True
    with pytest.raises(OSError):  # noqa: PT011 (refused or reset: nobody serves any more)
        socket.create_connection(tuple(hil.host.split(":")), 1.0)


def test_other_machines_need_the_token(tmp_path: Path) -> None:
    hil = Hil(tmp_path, "dash", "--port", "0", "--host", "0.0.0.0")
    try:
        port = hil.host.rpartition(":")[2]
        token = hil.address.rpartition("token=")[2]
        assert len(token) >= 32
        hil.host = f"127.0.0.1:{port}"
        assert hil.get("/").status == 401
        assert hil.get("/api/runs").status == 401
        moved = hil.get(f"/?token={token}")
        assert moved.status == 303
        cookie = moved.getheader("set-cookie", "").partition(";")[0]
        assert hil.get("/", Cookie=cookie).status == 200
        with pytest.raises(InvalidStatus):
            connect(f"ws://{hil.host}/live", open_timeout=PATIENCE_S).__enter__()
    finally:
        hil.end()


def test_a_busy_port_is_a_plain_error(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "hil.cli.entry", "dash", "--port", port]
        ended = subprocess.run(
            command,
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    assert ended.returncode == 2
    assert "--port" in ended.stderr
    assert "Traceback" not in ended.stderr
