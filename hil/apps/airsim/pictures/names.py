"""Objects by name: regular expressions and wildcards, as AirSim matches them (whole names, any case)."""

from __future__ import annotations

import re
from collections.abc import Iterable

from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.rpc.patterns import BoundedPattern, CostError

_MOST_CHARACTERS = 200
_PLAIN = re.compile(r"(?:[\w\s./:-]|\.[*+])*")  # one `.*` of these expressions costs little in `re`


def matching(pattern: str, names: Iterable[str], flags: int = re.IGNORECASE) -> list[str]:
    """Return the names that a regular expression matches. Raises RpcError for one that is none or is too costly."""
    try:
        if len(pattern) > _MOST_CHARACTERS:
            raise CostError(pattern)
        is_plain = _PLAIN.fullmatch(pattern) and pattern.count("*") + pattern.count("+") <= 1
        expression = re.compile(pattern, flags) if is_plain else BoundedPattern(pattern, flags)
        return [name for name in names if expression.fullmatch(name)]
    except CostError:
        raise RpcError(
            f"the regular expression '{pattern[:40]}' is too costly: use at most {_MOST_CHARACTERS} characters, fewer "
            "repetitions, no back reference, and no other group with (? than (?:...)"
        ) from None
    except (re.error, RecursionError, OverflowError) as error:
        raise RpcError(f"'{pattern[:60]}' is no regular expression: {error}") from None


def like(wildcards: str, name: str) -> bool:
    """Return True if a name matches a text in which * stands for any characters and ? for one."""
    text, wanted = name.lower(), wildcards.lower()
    at = star = 0
    kept, mark = -1, 0
    while at < len(text):
        if star < len(wanted) and wanted[star] in ("?", text[at]) and wanted[star] != "*":
            at, star = at + 1, star + 1
        elif star < len(wanted) and wanted[star] == "*":
            kept, mark, star = star, at, star + 1
        elif kept >= 0:
            mark += 1
            at, star = mark, kept + 1
        else:
            return False
    return all(character == "*" for character in wanted[star:])
