"""The parameter table (PX4's names, types, defaults and ranges) and the parameter protocol.

Parameters are INT32 or FLOAT (MAV_PARAM_TYPE_INT32, REAL32). As in PX4, the float field of a message carries the 32
bits of an INT32 ("bytewise" encoding), so payloads are packed from raw bytes: a float would not keep every bit pattern.
Values are rounded to float32, so that a ground station reads back exactly the value in use.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from pathlib import Path

from firmware_bridge import _native
from signals.errors import ConfigError, Problem

TYPE_INT32 = 6  # MAV_PARAM_TYPE
TYPE_REAL32 = 9

PARAM_VALUE_ID = 22
_NATIVE_INT32 = frozenset({"CA_ROTOR_COUNT"})  # the flight core takes doubles only; these are PX4 integers

_HERE = Path(__file__).parent
_value_payload = struct.Struct("<4sHH16sB").pack
_int32 = struct.Struct("<i")
_float32 = struct.Struct("<f")


class Param:
    """One parameter. `value` is int for INT32, float (rounded to float32) for FLOAT."""

    __slots__ = ("index", "maximum", "minimum", "name", "type", "value")

    def __init__(self, name: str, kind: int, value: float, minimum: float, maximum: float) -> None:
        self.name = name
        self.type = kind
        self.minimum = minimum
        self.maximum = maximum
        self.index = 0
        self.value: float = 0
        self.value = self.rounded(value)

    def rounded(self, value: float) -> float:
        """Return `value` rounded to the 32 bits of the message field."""
        return int(value) if self.type == TYPE_INT32 else _float32.unpack(_float32.pack(value))[0]

    def refusal(self, value: float) -> str | None:
        """Return why `value` cannot be set, or None."""
        if not abs(value) < 3.4e38:  # NaN, infinities and values beyond float32
            return "not a finite number"
        if not self.minimum <= value <= self.maximum:
            return f"outside {self.minimum:g} .. {self.maximum:g}"
        if self.type == TYPE_INT32 and not -(2**31) <= value < 2**31:
            return "outside 32 bits"
        return None


def _limit(word: str, default: float) -> float:
    return default if word == "-" else float(word)


def _lines(path: Path) -> Iterable[tuple[int, list[str]]]:
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            yield number, words


_KINDS = {0: "multirotor", 1: "plane", 2: "VTOL"}  # by CA_AIRFRAME


def airframe_kind(airframe: str) -> str:
    """Return what an airframe's file makes the mock: "multirotor", "plane" or "VTOL", by its CA_AIRFRAME."""
    path = _HERE / "airframes" / f"{airframe}.params"
    lines = [words for _, words in _lines(path)] if path.is_file() else []
    return next((_KINDS[int(words[1])] for words in lines if words[0] == "CA_AIRFRAME"), _KINDS[0])


def _accept(name: str, value: float) -> str | None:  # noqa: ARG001
    return None


def airframes() -> list[str]:
    """Return the names of the airframes that have a file."""
    return sorted(path.stem for path in (_HERE / "airframes").glob("*.params"))


class ParamTable:
    """All parameters, in alphabetical order, which is PX4's index order.

    `on_change(name, value)` is called before each change and returns None, or why it is refused; `after_change()` is
    called after it.
    """

    def __init__(
        self,
        native: Iterable[tuple[str, float, float, float]] = (),
        *,
        hitl: bool = False,
        plane: bool = False,
        vtol: bool = False,
    ) -> None:
        """`native`: name, default, minimum, maximum of the flight core's parameters (not in `parameters.txt`).

        `hitl`: add the parameters of a board built for HITL (`parameters_hitl.txt`); `plane`: those of a plane
        (`parameters_plane.txt`), with its defaults for those that both have; `vtol`, beside `plane`: those of a VTOL
        (`parameters_vtol.txt`) with its defaults.
        """
        params: dict[str, Param] = {}
        files = ["parameters.txt"]
        files += ["parameters_hitl.txt"] if hitl else []
        files += ["parameters_plane.txt"] if plane else []
        files += ["parameters_vtol.txt"] if vtol else []
        for file in files:
            for _, (name, kind, default, minimum, maximum) in _lines(_HERE / file):
                params[name] = Param(
                    name,
                    TYPE_INT32 if kind == "INT32" else TYPE_REAL32,
                    float(default),
                    _limit(minimum, float("-inf")),
                    _limit(maximum, float("inf")),
                )
        for name, value, low, high in native:
            native_kind = TYPE_INT32 if name in _NATIVE_INT32 else TYPE_REAL32
            params[name] = Param(name, native_kind, value, low, high)
        self._params = sorted(params.values(), key=lambda p: p.name)
        for index, param in enumerate(self._params):
            param.index = index
        self._by_name = {param.name: param for param in self._params}
        self.clear_callbacks()

    @classmethod
    def of_firmware(cls, *, hitl: bool = False, plane: bool = False, vtol: bool = False) -> ParamTable:
        """Return the parameters of the mock's firmware, those of its flight core among them."""
        columns = (_native.PARAM_NAMES, _native.PARAM_DEFAULTS, _native.PARAM_MIN, _native.PARAM_MAX)
        return cls(zip(*columns, strict=True), hitl=hitl, plane=plane, vtol=vtol)

    def clear_callbacks(self) -> None:
        """Remove the callbacks `on_change` and `after_change`."""
        self.on_change: Callable[[str, float], str | None] = _accept
        self.after_change: Callable[[], None] = lambda: None

    def __len__(self) -> int:
        return len(self._params)

    def __getitem__(self, name: str) -> float:
        return self._by_name[name].value

    def __contains__(self, name: str) -> bool:
        return name in self._by_name

    def names(self) -> list[str]:
        """Return all names in index order."""
        return [param.name for param in self._params]

    def find(self, name: str, index: int = -1) -> Param | None:
        """Return the parameter of that name, or of that index if `index` >= 0, or None."""
        if index >= 0:
            return self._params[index] if index < len(self._params) else None
        return self._by_name.get(name)

    def set(self, name: str, value: float) -> str | None:
        """Change a parameter. Return why it was refused, or None."""
        param = self._by_name.get(name)
        if param is None:
            return "no such parameter"
        refusal = param.refusal(value)
        if refusal is None:
            rounded = param.rounded(value)
            refusal = self.on_change(name, rounded)
            if refusal is None:
                param.value = rounded
                self.after_change()
        return refusal

    def load_airframe(self, name: str) -> None:
        """Apply `airframes/NAME.params`. Raises ConfigError with every error of the file."""
        path = _HERE / "airframes" / f"{name}.params"
        if not path.is_file():
            known = ", ".join(airframes())
            raise ConfigError.at("--airframe", f"no airframe {name!r}", f"there are: {known}")
        problems = []
        for number, words in _lines(path):
            refusal = self.set(words[0], float(words[1]))
            if refusal:
                problems.append(Problem(f"{path.name}:{number}", f"{words[0]}: {refusal}"))
        if problems:
            raise ConfigError(problems)

    def load(self, assignments: Iterable[str]) -> None:
        """Apply `NAME=VALUE` strings. Raises ConfigError with every wrong one."""
        problems = []
        for text in assignments:
            name, _, value = text.partition("=")
            try:
                refusal = self.set(name.strip(), float(value))
            except ValueError:
                refusal = "not NAME=NUMBER"
            if refusal:
                problems.append(Problem(f"parameter {text}", refusal, self._hint(name)))
        if problems:
            raise ConfigError(problems)

    def _hint(self, name: str) -> str:
        """Return the nearest existing names for one that does not exist."""
        if name in self._by_name:
            return ""
        near = get_close_matches(name, self._by_name, n=3)
        return f"did you mean {', '.join(near)}?" if near else "names are PX4's, in capitals"

    def value_payload(self, param: Param) -> bytes:
        """Pack the payload of PARAM_VALUE (bytewise encoding)."""
        bits = _int32.pack(int(param.value)) if param.type == TYPE_INT32 else _float32.pack(param.value)
        return _value_payload(bits, len(self._params), param.index, param.name.encode(), param.type)


_read_request = struct.Struct("<hBB16s").unpack  # PARAM_REQUEST_READ: index, target system, component, name
_set_request = struct.Struct("<4sBB16sB").unpack  # PARAM_SET: value bits, target system, component, name, type


class ParamService:
    """Service of PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET.

    `send(msgid, payload)` queues a message. A list is paced in simulated time: `start_list` starts a timer that calls
    `send_next` until it returns False.
    """

    def __init__(
        self,
        table: ParamTable,
        send: Callable[[int, bytes], None],
        start_list: Callable[[], None],
        warn: Callable[[str], None],
    ) -> None:
        self.table = table
        self._send = send
        self._start_list = start_list
        self._warn = warn
        self._cursor = len(table)

    def request_list(self) -> None:
        """Start, or restart, sending every parameter."""
        self._cursor = 0
        self._start_list()

    def send_next(self) -> bool:
        """Send the next parameter of the list. Return False if there is none left."""
        param = self.table.find("", self._cursor)
        if param is None:
            return False
        self._cursor += 1
        self._send(PARAM_VALUE_ID, self.table.value_payload(param))
        return True

    def request_read(self, payload: bytes) -> None:
        """Answer PARAM_REQUEST_READ by name or index; warn about an unknown one, as PX4 does."""
        index, _, _, raw_name = _read_request(payload)
        name = _ascii(raw_name)
        param = self.table.find(name, index)
        if param is None:
            self._warn(f"unknown param: {name}" if index < 0 else f"unknown param ID: {index}")
        else:
            self._send(PARAM_VALUE_ID, self.table.value_payload(param))

    def set(self, payload: bytes) -> None:
        """Handle PARAM_SET and answer with the value now set, also if the new one was refused."""
        bits, _, _, raw_name, kind = _set_request(payload)
        name = _ascii(raw_name)
        param = self.table.find(name)
        if param is None:
            self._warn(f"unknown param: {name}")
            return
        if kind != param.type:
            self._warn(f"param types mismatch param: {name}")
        else:
            value = _int32.unpack(bits)[0] if kind == TYPE_INT32 else _float32.unpack(bits)[0]
            refusal = self.table.set(name, value)
            if refusal:
                self._warn(f"{name} refused: {refusal}")
        self._send(PARAM_VALUE_ID, self.table.value_payload(param))


def _ascii(raw_name: bytes) -> str:
    """Decode the name in a message field; bytes outside ASCII become '?'."""
    return raw_name.split(b"\0", 1)[0].decode("ascii", "replace").replace("\ufffd", "?")
