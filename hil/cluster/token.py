"""Token of a Ray cluster.

From Ray 2.60 on, a cluster whose head has a token lets only those in who send the same one. Ray looks for it in
RAY_AUTH_TOKEN, then in the file that RAY_AUTH_TOKEN_PATH names, then in ~/.ray/auth_token, where `ray get-auth-token
--generate` writes it. It sends it only if RAY_AUTH_MODE is `token`. A head and a cluster on this machine set that by
themselves as soon as there is a token; whoever joins by an address does not, so it is done here.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_MODE, _TOKEN, _PATH = "RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"
_REFUSED = ("AuthToken", "AuthenticationError")  # in what Ray says when a cluster does not let it in


def token_place() -> str:
    """Return where this machine has a token, as Ray looks for it; empty if it has none."""
    for name in (_TOKEN, _PATH):
        if os.environ.get(name):
            return name
    with suppress(OSError, RuntimeError):  # a user without a home directory
        if (Path.home() / ".ray" / "auth_token").read_text().strip():
            return "~/.ray/auth_token"
    return ""


def use_token() -> bool:
    """Have Ray send the token of this machine, in this process and its children; False if there is nothing to change.

    Call it before Ray is imported, and only for a cluster that asks: a process that sends its token also wants it from
    those who fetch its objects.
    """
    if _MODE in os.environ or not token_place():
        return False
    os.environ[_MODE] = "token"
    return True


def is_refused(said: str) -> bool:
    """Return True if Ray said that a cluster did not take its token, or that it has none."""
    return any(word in said for word in _REFUSED)


def refusal(said: str) -> str:
    """Return what a cluster misses that did not let Ray in, from what Ray `said`; empty if that was not the token."""
    if not is_refused(said):
        return ""
    mode, place = os.environ.get(_MODE, "token"), token_place()
    if mode.lower() != "token":
        return f"it asks for its token, and {_MODE} is {mode!r} here; unset that, or set it to token"
    if not place:
        return (
            "it asks for its token, and this machine has none; `ray get-auth-token` prints it on the head: write it to "
            f"~/.ray/auth_token here, or set {_TOKEN}"
        )
    return f"it does not take the token of {place}; it has to be that which `ray get-auth-token` prints on the head"
