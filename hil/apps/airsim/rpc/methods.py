"""Methods of the server by name: their parameters, the check of a call, and the errors that a client receives.

The texts of errors are rpclib's, because scripts look for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Protocol

from hil.apps.airsim.rpc.arguments import ArgumentError, Type
from signals.errors import HilError


class RpcError(Exception):
    """Error of one call, for the client that made it: what was wrong and what to do."""


class Parameter(NamedTuple):
    """Parameter of a method. Only the last ones may have a default: clients of older versions leave them out."""

    name: str
    type: Type
    default: Any = ...  # the parameter is required

    @property
    def required(self) -> bool:
        """True if every client sends it."""
        return self.default is ...


class Pending:
    """Result that comes later, in simulated time: of a move, or of a continued simulation."""

    def __init__(self) -> None:
        self.done = False
        self.result: Any = None
        self._listeners: list[Callable[[Any], None]] = []

    def then(self, listener: Callable[[Any], None]) -> None:
        """Call `listener` with the result, at once if it is there."""
        if self.done:
            listener(self.result)
        else:
            self._listeners.append(listener)

    def resolve(self, result: Any) -> None:
        """Set the result. A second one is ignored."""
        if self.done:
            return
        self.done, self.result = True, result
        listeners, self._listeners = self._listeners, []
        for listener in listeners:
            listener(result)


class Caller(NamedTuple):
    """Client that makes a call: a number that no other connection of this server has had, and its address."""

    number: int
    address: str


class Method(NamedTuple):
    """One RPC method. `call` receives the converted arguments.

    `is_long` tells from the arguments if the call must not hold up the event loop (`hil.apps.airsim.rpc.world_lock`).
    A method that is `free` of the world is answered during such a call. Clients wait for one that `is_joined` with
    .join(), which hides its error.
    """

    name: str
    call: Callable[..., Any]
    parameters: tuple[Parameter, ...] = ()
    is_long: Callable[..., bool] = lambda *_: False
    is_free: bool = False
    is_joined: bool = False

    def arguments(self, values: Sequence[Any]) -> list[Any]:
        """Return the arguments of a call, in Python's form and complete. Raises RpcError with rpclib's texts."""
        parameters = self.parameters
        given, most = len(values), len(parameters)
        if given > most or (given < most and parameters[given].required):
            least = sum(parameter.required for parameter in parameters)
            expected = str(most) if least == most else f"{least} to {most}"
            raise RpcError(
                f"rpclib: client error C0001: Function '{self.name}' was called with an invalid number of arguments. "
                f"Expected: {expected}, got: {given}"
            )
        found = []
        for number, (parameter, value) in enumerate(zip(parameters, values, strict=False), start=1):
            try:
                found.append(parameter.type.convert(value))
            except ArgumentError as error:
                raise refused(self.name, given, f"argument {number} ({parameter.name}): {error}") from None
        found += [parameter.default for parameter in parameters[given:]]
        return found


def refused(name: str, count: int, reason: str) -> RpcError:
    """Return the error of a method that was called and failed, in rpclib's words."""
    return RpcError(
        f"rpclib: function '{name}' (called with {count} arg(s)) threw an exception. "
        f"The exception contained this information: {reason.rstrip('.')}."
    )


class Lock(Protocol):
    """Lock of the world (`hil.apps.airsim.rpc.world_lock.WorldLock`)."""

    @property
    def held(self) -> bool:
        """True while a long call has the world."""
        ...

    def run(self, work: Callable[[], Any]) -> Pending:
        """Start work in a thread."""
        ...

    def then(self, listener: Callable[[], None]) -> None:
        """Call `listener` after the present work."""
        ...


class MethodTable:
    """All methods of a server."""

    def __init__(self, methods: Iterable[Method], lock: Lock | None = None) -> None:
        """`lock` None: no call is long."""
        self.lock = lock
        self._methods: dict[str, Method] = {}
        for method in methods:
            if method.name in self._methods:
                raise ValueError(f"two methods are named {method.name!r}")
            self._methods[method.name] = method
        self.calls: dict[str, int] = {}  # by name, in the order of the first calls
        self.refused: dict[str, int] = {}  # calls that ended with an error, by name
        self.unknown: dict[str, int] = {}  # names that no method has, as name(number of arguments)

    def __contains__(self, name: str) -> bool:
        return name in self._methods

    @property
    def names(self) -> list[str]:
        """Names of all methods, sorted."""
        return sorted(self._methods)

    def call(self, name: str, values: Sequence[Any]) -> Any:
        """Call a method and return its result, or a `Pending`. Raises RpcError for every mistake of the client."""
        method = self._methods.get(name)
        count = len(values)
        if method is None:
            key = f"{name[:80]}({count})"
            if key in self.unknown or len(self.unknown) < 1000:
                self.unknown[key] = self.unknown.get(key, 0) + 1
            raise RpcError(f"rpclib: server could not find function '{name}' with argument count {count}.")
        self.calls[name] = self.calls.get(name, 0) + 1
        arguments = method.arguments(values)

        def work() -> Any:
            try:
                return method.call(*arguments)
            except RpcError as error:
                if str(error).startswith("rpclib: "):
                    raise
                raise refused(name, count, str(error)) from None
            except HilError as error:
                raise refused(name, count, str(error)) from None

        if self.lock is None or not method.is_long(*arguments):
            return work()
        pending = self.lock.run(work)
        return pending.result if pending.done else pending

    def refuse(self, name: str, error: RpcError) -> str:
        """Count a call that ended with an error, and return the text about it for the log."""
        method = self._methods.get(name)
        if method is None:
            return str(error)
        self.refused[name] = self.refused.get(name, 0) + 1
        return (
            f"{error} The script's .join() does not tell; .get() in its place raises this."
            if method.is_joined
            else str(error)
        )

    def waits(self, name: str) -> bool:
        """Return True if a call must wait until a long one has ended."""
        if self.lock is None or not self.lock.held:
            return False
        method = self._methods.get(name)
        return method is not None and not method.is_free


def method(name: str, call: Callable[..., Any], *parameters: Parameter) -> Method:
    """Return a method; parameters in their order."""
    return Method(name, call, parameters)


def optional(name: str, kind: Type, default: Any) -> Parameter:
    """Return a parameter that older clients leave out."""
    return Parameter(name, kind, default)
