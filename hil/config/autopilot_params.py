"""Checks flight-controller parameters against those that the mock Pixhawk has, before anything starts."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from firmware_bridge import _native
from firmware_bridge.mock_pixhawk.params import ParamTable
from hil.signals.documents.validate import COMMAND_LINE, Located, at, nearest
from hil.signals.errors import Problem


@cache
def _table() -> ParamTable:
    columns = (_native.PARAM_NAMES, _native.PARAM_DEFAULTS, _native.PARAM_MIN, _native.PARAM_MAX)
    return ParamTable(zip(*columns, strict=True), hitl=True)


def param_problems(params: Mapping[str, float], located: Located) -> list[Problem]:
    """Every name that does not exist and every value outside its range, where it was written."""
    problems: list[Problem] = []
    for name, value in params.items():
        place = ("autopilot", "params", name)
        param = _table().find(name)
        if param is None:
            hint = nearest(name, _table().names())
            if not hint.startswith("did"):
                hint = "names are PX4's; the mock has those in firmware_bridge/mock_pixhawk/parameters.txt"
            elif located.where(place).startswith(COMMAND_LINE):
                hint = hint.replace("'", "'autopilot.params.", 1)
            problems.append(at(located, place, "is unknown to the mock autopilot", hint))
        elif (refusal := param.refusal(value)) is not None:
            problems.append(at(located, place, f"cannot be {value:g}: it is {refusal}"))
    return problems
