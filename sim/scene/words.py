"""The nearest known word to one that is not."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_MAX_WORD = 100  # characters of a longer word that are compared
_MAX_KNOWN = 2000  # words that are compared with


def nearest(word: str, known: Iterable[str], *, listed: bool = True) -> str:
    """'did you mean ...?' if one of `known` is close to `word`, else, where `listed`, what there is."""
    names = list(known)[:_MAX_KNOWN]
    lowered = {name.lower(): name for name in names}
    close = difflib.get_close_matches(word[:_MAX_WORD].lower(), lowered, n=1, cutoff=0.6)
    if close:
        return f"did you mean {lowered[close[0]]!r}?"
    return "known: " + ", ".join(names) if names and listed else ""
