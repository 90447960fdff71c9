"""CUTs by name: the shipped ones, or MODULE:NAME of the user's own.

The settings of a CUT (--set key=value) are the keyword arguments of its class. A shipped CUT declares them as the
fields of a dataclass, its `settings_type`.
"""

from __future__ import annotations

import difflib
import importlib
import inspect
import json
import sys
from typing import Any, Iterable

from hil_companion.errors import OptionError

SHIPPED = {
    "detect": "hil_companion.cuts.detect:Detect",
    "echo": "hil_companion.cuts.echo:Echo",
    "record": "hil_companion.cuts.record:Record",
    "explore": "hil_companion.cuts.explore:Explore",
    "waypoints": "hil_companion.cuts.waypoints:Waypoints",
}


def make_cut(name: str, settings: Iterable[str] = ()) -> Any:
    """Make the CUT of that name with settings KEY=VALUE (a value is JSON, or else text). Raises OptionError."""
    cut = _find(name)
    options = dict(_setting(text) for text in settings)
    if not inspect.isclass(cut):
        if options:
            raise OptionError(f"{name}: a function, which takes no --set")
        return cut
    legal = _options(cut)
    for key in options:
        if key not in legal:
            raise OptionError(
                f"{name} has no setting {key!r}{_nearest(key, legal)}; it has {', '.join(legal) or 'none'}"
            )
    try:
        return cut(**options)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name}: {error}") from error


def _find(name: str) -> Any:
    module, colon, attribute = SHIPPED.get(name, name).partition(":")
    if not colon:
        raise OptionError(f"no CUT {name!r}{_nearest(name, SHIPPED)}; there are {', '.join(SHIPPED)}, or MODULE:NAME")
    if name not in SHIPPED and "" not in sys.path:
        sys.path.insert(0, "")  # the user's own CUT lies in the folder where the command is started
    try:
        cut = getattr(importlib.import_module(module), attribute, None)
    except ImportError as error:
        raise OptionError(f"{name}: cannot be imported ({error})") from error
    if not callable(cut):
        raise OptionError(f"{name}: {module} has no function or class {attribute!r}")
    return cut


def _options(cut: type) -> dict[str, Any]:
    """Return the names of a class's settings with their defaults."""
    # A subclass of a shipped CUT with an __init__ of its own takes the arguments of this __init__ as settings.
    owner = next(kind for kind in cut.__mro__ if "__init__" in vars(kind))
    parameters = inspect.signature(vars(owner).get("settings_type", cut)).parameters.values()
    return {p.name: p.default for p in parameters if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)}


def _setting(text: str) -> Any:
    key, equals, value = text.partition("=")
    if not key or not equals:
        raise OptionError(f"--set {text!r}: KEY=VALUE is needed")
    try:
        return key, json.loads(value)
    except ValueError:
        return key, value


def _nearest(name: str, legal: Iterable[str]) -> str:
    matches = difflib.get_close_matches(name, list(legal), n=1)
    return f"; did you mean {matches[0]!r}?" if matches else ""
