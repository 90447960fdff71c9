"""Access control: no requests of other sites or under other names, and none without a token that is needed."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from firmware_bridge.transports.loopback_host import is_loopback
from hil.apps.dash.server.authenticator import Authenticator

HOST = "127.0.0.1:8710"


async def _inside(scope: Any, receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"inside"})


def ask(
    *,
    token: str | None = None,
    kind: str = "http",
    method: str = "GET",
    path: str = "/x",
    query: str = "",
    **headers: str,
) -> list[dict[str, Any]]:
    headers.setdefault("host", HOST)
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()],
    }
    said: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        said.append(dict(message))

    async def receive() -> Any:
        raise AssertionError("a refused request must not be read")

    asyncio.run(Authenticator(_inside, token=token)(scope, receive, send))
    return said


def status(**request: Any) -> int:
    said = ask(**request)[0]
    if said["type"].startswith("websocket"):
        return 101 if said["type"] == "websocket.accept" else 403
    return int(said["status"])


def test_the_page_itself_is_accepted() -> None:
    assert status() == 200
    assert status(host="localhost:8710", origin="http://localhost:8710") == 200
    assert status(host="[::1]:8710") == 200
    assert status(kind="websocket", origin=f"http://{HOST}", sec_fetch_site="same-origin") == 101
    assert status(method="POST", origin=f"http://{HOST}") == 200


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "http://localhost:8710",
        "http://127.0.0.1:8711",
        "null",
        "file://",
        f"http://{HOST}.evil.example",
    ],
)
def test_other_origins_are_refused(origin: str) -> None:
    assert status(origin=origin) == 403
    assert status(kind="websocket", origin=origin) == 403


@pytest.mark.parametrize("host", ["evil.example:8710", "127.0.0.1.evil.example", "10.0.0.5:8710", ""])
def test_other_host_names_are_refused(host: str) -> None:
    """DNS rebinding: the page's own name, resolved to this machine."""
    assert status(host=host) == 403
    assert status(kind="websocket", host=host, origin=f"http://{host}") == 403


def test_a_request_that_changes_something_needs_an_origin() -> None:
    assert status(method="POST") == 403
    assert status(sec_fetch_site="cross-site") == 403
    assert status(sec_fetch_site="same-site") == 403  # a page of another port of this machine
    assert status(sec_fetch_site="cross-site", path="/") == 200  # a link to the page, followed by a person


def test_the_token_is_required_and_moves_from_the_address_to_a_cookie() -> None:
    assert status(token="secret", host="bench:8710") == 401
    assert status(token="secret", host="bench:8710", query="token=wrong") == 401
    assert status(token="secret", host="bench:8710", cookie="hil_dash=wrong; other=secret") == 401
    assert status(token="secret", host="bench:8710", cookie="a=b; hil_dash=secret") == 200
    assert status(token="secret", kind="websocket", host="bench:8710", origin="http://bench:8710") == 403
    moved = ask(token="secret", host="bench:8710", path="//evil.example/", query="token=secret&a=1")[0]
    headers = dict(moved["headers"])
    assert moved["status"] == 303
    assert headers[b"location"] == b"/evil.example/?a=1"
    assert b"HttpOnly" in headers[b"set-cookie"]
    assert b"samesite=strict" in headers[b"set-cookie"].lower()


def test_the_policy_allows_no_content_of_other_sites() -> None:
    policy = dict(ask()[0]["headers"])[b"content-security-policy"].decode()
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert "unsafe" not in policy


def test_loopback() -> None:
    assert all(is_loopback(host) for host in ("localhost", "127.0.0.1", "127.9.9.9", "::1", "[::1]"))
    assert not any(is_loopback(host) for host in ("0.0.0.0", "::", "192.168.1.2", "bench", "127.0.0.1.nip.io"))


@pytest.mark.parametrize("origin", ["http://[::1", "http://[", "//", "\\\\", "http://127.0.0.1:8710@evil.example"])
def test_an_origin_that_is_no_address_is_refused(origin: str) -> None:
    assert status(origin=origin) == 403


@pytest.mark.parametrize("path", ["//evil.com/", "/\\evil.com/", "/\t/evil.com/", "/\\/\\evil.com/", "/\r\n/evil.com/"])
def test_a_token_in_an_address_never_leads_to_another_host(path: str) -> None:
    (answer,) = (said for said in ask(token="T", query="token=T", path=path) if "headers" in said)
    assert dict(answer["headers"])[b"location"] == b"/evil.com/"
