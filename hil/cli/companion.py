"""`hil companion`: a client under test on this machine.

The client lives in `rigs/jetson`, as a package of its own that knows nothing of the bench, so that it can be copied to
a companion computer, where `python -m hil_companion` is the same. From here it is found by that path.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer


def companion(
    name: Annotated[
        str, typer.Argument(help="echo, record, waypoints, explore, or MODULE:NAME of your own.", metavar="NAME")
    ],
    connect: Annotated[str, typer.Option(help="tcp://HOST:PORT or ipc://FILE of a bench.", metavar="ADDR")],
    client_name: Annotated[str | None, typer.Option("--name", help="What the bench calls it; default NAME.")] = None,
    topics: Annotated[
        list[str] | None, typer.Option(help="What to receive, shell patterns, e.g. front/*,imu.", metavar="A,B")
    ] = None,
    key: Annotated[Path | None, typer.Option(help="This client's secret key (`hil keys`).", metavar="FILE")] = None,
    bench_key: Annotated[Path | None, typer.Option(help="The bench's public key.", metavar="FILE")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="A setting of the client. May be repeated.", metavar="KEY=VALUE")
    ] = None,
    control: Annotated[bool, typer.Option("--control", help="Ask to command, for one of your own.")] = False,
    hold: Annotated[
        bool, typer.Option("--hold", help="What it desires is flown as it stands, not carried on.")
    ] = False,
    credit: Annotated[int, typer.Option(help="Frames on the way at once.")] = 1,
    no_shared_memory: Annotated[
        bool, typer.Option("--no-shared-memory", help="Even where the bench is on this machine.")
    ] = False,
    wait: Annotated[float, typer.Option(help="Seconds for the bench to be there.")] = 30.0,
    reconnect: Annotated[float, typer.Option(help="Seconds to come back after a loss; default for ever.")] = math.inf,
) -> None:
    """Run a client under test against a bench."""
    from hil.companion.started import use_client

    use_client()
    from hil_companion.command import start, topic_list

    status: int = start(
        name,
        connect,
        name=client_name,
        topics=topic_list(topics or ()),
        key=key,
        bench_key=bench_key,
        settings=settings or (),
        control=control,
        hold=hold,
        credit=credit,
        shared_memory=not no_shared_memory,
        wait_s=wait,
        reconnect_s=reconnect,
    )
    raise typer.Exit(status)
