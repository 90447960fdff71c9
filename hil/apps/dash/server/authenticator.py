"""Access control of the page's server, applied before the body of a request is read.

- Host and Origin, by the rules of `firmware_bridge.transports.browser_requests`.
- Token. If other machines can reach the port, every request needs the token: first in the address, then as a cookie. No
  other site can send this cookie (SameSite=Strict), and no script can read it (HttpOnly).
"""

from __future__ import annotations

import hmac
from urllib.parse import quote, urlencode

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from firmware_bridge.transports.browser_requests import refusal

COOKIE = "hil_dash"
# No content of other sites, no frames, no inline scripts. Pictures made in the page are blobs.
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "content-security-policy": _POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Authenticator:
    """ASGI application that passes accepted requests on to `app`. `token` None: served on loopback only."""

    def __init__(self, app: ASGIApp, *, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        request = HTTPConnection(scope)
        refusal = self._refusal(request)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        reply: ASGIApp = self._app
        if refusal is not None and scope["type"] == "websocket":
            # The client sees HTTP 403.
            await send({"type": "websocket.close", "code": 1008, "reason": refusal[1]})
            return
        if refusal is not None:
            reply = PlainTextResponse(refusal[1], refusal[0])
        elif self._token is not None and scope["type"] == "http" and "token" in request.query_params:
            reply = self._token_to_cookie(request, self._token)
        await reply(scope, receive, with_headers)

    def _refusal(self, request: HTTPConnection) -> tuple[int, str] | None:
        origins = request.headers.getlist("origin")
        refused = refusal(request.headers.getlist("host"), origins, loopback_only=self._token is None)
        if refused is not None:
            return refused
        if not origins and request.scope["type"] == "http" and request.scope["method"] not in ("GET", "HEAD"):
            return 403, "a request that changes something needs an Origin header"
        fetched = request.headers.get("sec-fetch-site", "none")
        if fetched not in ("same-origin", "none") and request.scope.get("path") != "/":
            return 403, "no requests from pages of other sites"
        if self._token is not None:
            offered_tokens = (request.query_params.get("token", ""), request.cookies.get(COOKIE, ""))
            if not any(hmac.compare_digest(text.encode(), self._token.encode()) for text in offered_tokens):
                return 401, "the address needs ?token=..., as `hil dash` printed it"
        return None

    @staticmethod
    def _token_to_cookie(request: HTTPConnection, token: str) -> ASGIApp:
        """Return a redirect to the address without the token, which sets the cookie. Addresses end up in logs."""
        query = {name: value for name, value in request.query_params.items() if name != "token"}
        # Exactly one leading slash: an address that begins with two would name another host. Browsers read backslashes
        # as slashes, and drop control characters.
        path = "/" + quote(request.scope["path"].lstrip("/\\\t\r\n")) + (f"?{urlencode(query)}" if query else "")
        redirect = RedirectResponse(path, 303)
        redirect.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return redirect
