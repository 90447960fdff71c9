"""Pages of other sites in a real browser: they reach neither Foxglove's server nor the SDK's behind its gate."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from hil.run.parts.links.foxglove.gate import Gate, inner_addresses
from tests.worlds.bench_process import free_port
from tests.worlds.chromium import chromium, needs_chromium, patient
from tests.worlds.foxglove_client import PROTOCOL, FoxgloveClient

foxglove = pytest.importorskip("foxglove", reason="needs Foxglove's SDK: pip install 'hil-bench[foxglove]'")
pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = needs_chromium

TRY = """([address, protocol]) => new Promise(done => {
    let socket;
    try { socket = new WebSocket(address, protocol); } catch (error) { done("refused: " + error.name); return; }
    socket.onmessage = event => done("got " + JSON.parse(event.data).op);
    socket.onclose = () => done("refused");
})"""


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    site = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=site.serve_forever, daemon=True).start()
    with chromium() as browser:
        page = patient(browser.new_context()).new_page()
        page.goto(f"http://127.0.0.1:{site.server_address[1]}/")
        yield page
    site.shutdown()


def test_a_page_reaches_a_run_only_if_its_origin_is_named(page: Any) -> None:
    origin = page.evaluate("location.origin")
    host, port = next(inner_addresses())
    server = foxglove.start_server(host=host, port=port, context=foxglove.Context())
    results = []
    for sites in ([], ["https://app.foxglove.dev"], [origin]):
        gate = Gate("127.0.0.1", 0, loopback_only=True, sites=sites)
        gate.start((host, port))
        results.append(page.evaluate(TRY, [f"ws://localhost:{gate.port}", PROTOCOL]))
        gate.close(0.1)
    server.stop()
    assert results == ["refused", "refused", "got serverInfo"]


def test_a_page_reaches_no_server_behind_the_gate(page: Any) -> None:
    port = free_port()
    open_to_all = foxglove.start_server(host="127.0.0.1", port=port, context=foxglove.Context())
    assert page.evaluate(TRY, [f"ws://127.0.0.1:{port}", PROTOCOL]) == "got serverInfo"  # what the gate is for
    open_to_all.stop()
    for host, port in inner_addresses():
        try:
            server = foxglove.start_server(host=host, port=port, context=foxglove.Context())
        except RuntimeError:  # taken by another program
            continue
        assert page.evaluate(TRY, [f"ws://{host}:{port}", PROTOCOL]).startswith("refused")
        client = FoxgloveClient(port, at=host)
        assert client.until(lambda client=client: client.server)
        client.close()
        server.stop()
