"""`hil companion`: runs a client under test on this machine.

The package `hil_companion` in `rigs/jetson` does not depend on the bench. It can be copied to a companion computer,
where `python -m hil_companion` runs the same clients.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import takes


@dataclass(frozen=True)
class CompanionOptions:
    name: Annotated[
        str, typer.Argument(help="detect, echo, explore, record, waypoints, or MODULE:NAME.", metavar="NAME")
    ]
    connect: Annotated[str, typer.Option(help="tcp://HOST:PORT or ipc://FILE of a bench.", metavar="ADDR")]
    client_name: Annotated[
        str | None, typer.Option("--name", help="Name of the client on the bench; default NAME.")
    ] = None
    topics: Annotated[
        list[str] | None, typer.Option(help="Topics to receive, as shell patterns: front/*,imu.", metavar="A,B")
    ] = None
    key: Annotated[Path | None, typer.Option(help="This client's secret key (`hil keys`).", metavar="FILE")] = None
    bench_key: Annotated[Path | None, typer.Option(help="The bench's public key.", metavar="FILE")] = None
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="A setting of the client. May be repeated.", metavar="KEY=VALUE")
    ] = None
    control: Annotated[
        bool, typer.Option("--control", help="Ask for control of the vehicle, for a client that does not declare it.")
    ] = False
    hold: Annotated[
        bool, typer.Option("--hold", help="Keep a desired state unchanged until the next one (no extrapolation).")
    ] = False
    credit: Annotated[int, typer.Option(help="Number of frames that may be in transit at once.")] = 1
    no_shared_memory: Annotated[
        bool, typer.Option("--no-shared-memory", help="Use no shared memory, even if the bench is on this machine.")
    ] = False
    wait: Annotated[float, typer.Option(help="Longest wait for the bench in seconds.")] = 30.0
    reconnect: Annotated[
        float, typer.Option(help="Longest time to reconnect after a loss in seconds; default no limit.")
    ] = math.inf


@takes(CompanionOptions)
def companion(o: CompanionOptions) -> None:
    """Run a client under test against a bench."""
    from hil.config.companion.clients import make_client_importable

    make_client_importable()
    from hil_companion.command import start, topic_list

    status: int = start(
        o.name,
        o.connect,
        name=o.client_name,
        topics=topic_list(o.topics or ()),
        key=o.key,
        bench_key=o.bench_key,
        settings=o.settings or (),
        control=o.control,
        hold=o.hold,
        credit=o.credit,
        shared_memory=not o.no_shared_memory,
        wait_s=o.wait,
        reconnect_s=o.reconnect,
    )
    raise typer.Exit(status)
