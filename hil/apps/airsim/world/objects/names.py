"""Objects by name: regular expressions and wildcards, as AirSim matches them (whole names).

RE2 takes a time proportional to the name for any expression. It has no back references and does not look ahead.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import re2

from hil.apps.airsim.rpc.methods import RpcError

_MOST_BYTES = 1 << 16  # of a compiled expression, about 1000 characters


def matching(pattern: str, names: Iterable[str], *, any_case: bool) -> list[str]:
    """Return the names that a regular expression matches. Raises RpcError for one that is none or is too large."""
    try:
        expression = _compiled(pattern, any_case=any_case, max_mem=_MOST_BYTES)
    except re2.error as error:
        reason = error.args[0].decode(errors="replace")
        raise RpcError(
            f"'{pattern[:60]}' is not a regular expression (https://github.com/google/re2): {reason}"
        ) from None
    return _matched(expression, names)


def like(wildcards: Iterable[str], names: Iterable[str]) -> set[str]:
    """Return the names that any of these texts matches, in any case: * stands for any characters and ? for one."""
    names = list(names)
    found: set[str] = set()
    for text in wildcards:
        known = text.encode(errors="replace").decode()
        pattern = "".join({"*": ".*", "?": "."}.get(character) or re2.escape(character) for character in known)
        found.update(_matched(_compiled(pattern, any_case=True, dot_nl=True), names))
    return found


def _compiled(pattern: str, *, any_case: bool, **changes: Any) -> Any:
    """Return an expression. Raises re2.error."""
    options = re2.Options()
    options.case_sensitive, options.never_capture, options.log_errors = not any_case, True, False
    for name, value in changes.items():
        setattr(options, name, value)
    return re2.compile(pattern.encode(errors="backslashreplace"), options)


def _matched(expression: Any, names: Iterable[str]) -> list[str]:
    return [name for name in names if expression.fullmatch(name.encode(errors="replace"))]
