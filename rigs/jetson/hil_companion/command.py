"""The stand-alone command: `python -m hil_companion NAME --connect ADDR`."""

from __future__ import annotations

import argparse
import math
import signal
from typing import Any, Sequence

from hil_companion.catalog import SHIPPED, make_cut
from hil_companion.errors import OptionError
from hil_companion.link.options import DEFAULT_WAIT_S
from hil_companion.runner import OPTION_STATUS, run, to_stderr


def start(
    cut_name: str,
    address: str,
    *,
    name: str | None = None,
    topics: Sequence[str] | None = None,
    settings: Sequence[str] = (),
    control: bool = False,
    hold: bool = False,
    **options: Any,
) -> int:
    """Make a CUT by name and run it; topics, control and hold come from the options, or else from the CUT.

    `options`: further arguments of `run`. Returns the exit status.
    """
    try:
        cut = make_cut(cut_name, settings)
    except OptionError as error:
        to_stderr(f"error: {error}")
        return OPTION_STATUS
    return run(
        cut,
        address,
        name=name if name is not None else cut_name.rpartition(":")[2],
        topics=list(topics) if topics else list(getattr(cut, "topics", ("*",))),
        control=control or bool(getattr(cut, "control", False)),
        hold=hold or bool(getattr(cut, "hold", False)),
        **options,
    )


def topic_list(texts: Sequence[str] | None) -> list[str] | None:
    """Split each text at its commas and return all patterns; None if there is none."""
    return [t.strip() for text in texts or () for t in text.split(",") if t.strip()] or None


def parser() -> argparse.ArgumentParser:
    options = argparse.ArgumentParser(
        prog="hil_companion", description="Run an algorithm under test (CUT) against a hardware-in-the-loop bench."
    )
    options.add_argument("cut", metavar="NAME", help=", ".join(SHIPPED) + ", or MODULE:NAME of your own")
    options.add_argument("--connect", required=True, metavar="ADDR", help="tcp://HOST:PORT or ipc://FILE")
    options.add_argument("--name", help="the client's name in the bench's report; default: the CUT's name")
    options.add_argument(
        "--topics", action="append", metavar="A,B", help="topics to receive, as shell patterns: front/*,imu"
    )
    options.add_argument("--key", metavar="FILE", help="this client's secret key")
    options.add_argument("--bench-key", metavar="FILE", help="the bench's public key")
    options.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of the CUT")
    options.add_argument(
        "--control", action="store_true", help="ask for permission to command, for a CUT that does not declare it"
    )
    options.add_argument(
        "--hold", action="store_true", help="the bench flies each desired state as it is, without extrapolation"
    )
    options.add_argument("--credit", type=int, default=1, help="frames that may be on the way at once; default 1")
    options.add_argument(
        "--no-shared-memory", action="store_true", help="use sockets even if the bench runs on this machine"
    )
    options.add_argument(
        "--wait", type=float, default=DEFAULT_WAIT_S, metavar="S", help="timeout for the bench to answer"
    )
    options.add_argument(
        "--reconnect",
        type=float,
        default=math.inf,
        metavar="S",
        help="timeout for reconnecting after a loss; default: unlimited",
    )
    return options


def _stop(number: int, frame: Any) -> None:  # noqa: ARG001
    raise KeyboardInterrupt


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status: 0 ended, 2 wrong options, 3 error."""
    # Both signals end the client with a bye to the bench. A service manager sends SIGTERM. SIGINT is ignored in a
    # background job of a shell script unless a handler is set.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    given = parser().parse_args(arguments)
    if math.isnan(given.wait) or math.isnan(given.reconnect):
        to_stderr("error: --wait and --reconnect must be numbers of seconds, not nan")
        return OPTION_STATUS
    return start(
        given.cut,
        given.connect,
        name=given.name,
        topics=topic_list(given.topics),
        settings=given.set,
        control=given.control,
        hold=given.hold,
        credit=given.credit,
        shared_memory=not given.no_shared_memory,
        key=given.key,
        bench_key=given.bench_key,
        wait_s=given.wait,
        reconnect_s=given.reconnect,
    )
