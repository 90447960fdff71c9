"""Who may talk to the page's server: the outermost layer, before anything is read of a request.

- Host. A page of another name that was made to resolve to this machine (DNS rebinding) sends its own name here. On
  loopback only loopback's names are answered.
- Origin. Browsers say which page a request comes from. One that is not ours is refused, for pages and sockets alike.
- Token. Where others can reach the port, every request needs the token: once in the address, then as a cookie that no
  other site can send along (SameSite=Strict) and no script can read (HttpOnly).
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "hil_dash"
_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
# Nothing from outside, no frames, no inline scripts. Pictures made in the page are blobs.
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]


class Guard:
    """An ASGI application round another. `token` None: loopback only, where none is needed."""

    def __init__(self, app: App, *, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(scope, send, *refusal)
            return
        if self._token is not None and scope["type"] == "http" and "token" in _query(scope):
            await self._keep_token(scope, send)
            return

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                own = {name.lower() for name, _ in message.get("headers", ())}
                more = [(name, value) for name, value in _HEADERS if name not in own]
                message["headers"] = [*message.get("headers", ()), *more]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        hosts, origins = _headers(scope, b"host"), _headers(scope, b"origin")
        if len(hosts) != 1 or len(origins) > 1:
            return 400, "one Host and at most one Origin are needed"
        host = hosts[0].lower()
        if self._token is None and _name_of(host) not in _LOOPBACK_NAMES:
            return 403, "this page is served to this machine only, under the name localhost"
        if origins:
            parts = urlsplit(origins[0].lower())
            if parts.scheme not in ("http", "https") or parts.netloc != host:
                return 403, "no requests from pages of other sites"
        elif scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            return 403, "a request that changes something must say which page it comes from"
        fetched = _headers(scope, b"sec-fetch-site")
        if fetched and fetched[0] not in ("same-origin", "none") and scope.get("path") != "/":
            return 403, "no requests from pages of other sites"
        if self._token is not None and not self._has_token(scope):
            return 401, "the address needs ?token=..., as `hil dash` printed it"
        return None

    def _has_token(self, scope: Scope) -> bool:
        assert self._token is not None
        offered = [_query(scope).get("token", "")]
        for header in _headers(scope, b"cookie"):
            for part in header.split(";"):
                name, _, value = part.strip().partition("=")
                if name == COOKIE:
                    offered.append(value)
        wanted = self._token.encode()
        return any(hmac.compare_digest(one.encode(), wanted) for one in offered)

    async def _keep_token(self, scope: Scope, send: Send) -> None:
        """To a cookie, and out of the address: addresses end up in histories and logs."""
        rest = {name: value for name, value in _query(scope).items() if name != "token"}
        # One slash in front: an address that begins with two would name another host.
        to = "/" + scope["path"].lstrip("/") + (f"?{urlencode(rest)}" if rest else "")
        cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        headers = [(b"location", to.encode("latin-1", "replace")), (b"set-cookie", cookie.encode()), *_HEADERS]
        await send({"type": "http.response.start", "status": 303, "headers": headers})
        await send({"type": "http.response.body", "body": b""})


def _headers(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


def _name_of(host: str) -> str:
    """Of 'name:port' or '[::1]:port'."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0]


def _query(scope: Scope) -> dict[str, str]:
    return dict(parse_qsl(scope.get("query_string", b"").decode("latin-1")))


async def _refuse(scope: Scope, send: Send, status: int, why: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": why})  # before it was accepted: HTTP 403
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *_HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": why.encode()})
