"""Options that several commands share, and a decorator for commands whose options are the fields of a dataclass."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

ConfigArgument = Annotated[Path | None, typer.Argument(help="Bench file; default ./hil.yaml.", metavar="[CONFIG]")]
RigOption = Annotated[str | None, typer.Option(help="Rig: autopilot and links (rigs/*.yaml).")]
SceneOption = Annotated[str | None, typer.Option(help="Scene (rigs/scenes/*.yaml).")]
MissionOption = Annotated[str | None, typer.Option(help="Mission: a .plan or .waypoints file, or a script (.yaml).")]
SeedOption = Annotated[int | None, typer.Option(help="Seed of all noise.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Override any key, e.g. --set sensors.gps.rate_hz=5. May be repeated.", metavar="KEY=VALUE"
    ),
]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the results; default runs/<time>-<rig>.")]
DashHostOption = Annotated[
    str, typer.Option(help="Address to serve the page on; on any but loopback the page needs the printed token.")
]
DashPortOption = Annotated[int, typer.Option(help="Port of the page; 0: any free port.", min=0, max=65535)]
EngineOption = Annotated[str, typer.Option(help="local: processes on this machine. ray: a Ray cluster.")]
AddressOption = Annotated[
    str | None, typer.Option(help="Address of the Ray cluster; default one on this machine.", show_default=False)
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print no progress, only the result.")]

Options = TypeVar("Options")


def options_of(kind: type[Options], o: object, **others: Any) -> Options:
    """Return an application's options: from a command's those of the same names, and `others`."""
    names = {field.name for field in fields(kind)} & vars(o).keys() - others.keys()  # type: ignore[arg-type]
    return kind(**{name: getattr(o, name) for name in names}, **others)


def takes(options: type[Options]) -> Callable[[Callable[[Options], None]], Callable[..., None]]:
    """Make a command of a function whose one parameter is the dataclass `options`.

    Typer sees one parameter for each field, in the fields' order and with their defaults and annotations.
    """
    hints = get_type_hints(options, include_extras=True)
    parameters = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(options)  # type: ignore[arg-type]
    ]

    def with_signature(command: Callable[[Options], None]) -> Callable[..., None]:
        def parsed(**values: Any) -> None:
            command(options(**values))

        parsed.__name__, parsed.__doc__, parsed.__module__ = command.__name__, command.__doc__, command.__module__
        parsed.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        parsed.__annotations__ = hints
        return parsed

    return with_signature
