"""The stand-alone command: `python -m hil_companion NAME --connect ADDR`."""

from __future__ import annotations

import argparse
import math
import signal
from typing import Any, Sequence

from hil_companion.catalog import SHIPPED, make_cut
from hil_companion.client import DEFAULT_WAIT_S
from hil_companion.errors import OptionError
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
    """Make a CUT by name and run it; what it does not say of itself (topics, control, hold) comes from the options."""
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
    """Patterns out of options that may each hold several, with commas between."""
    return [t.strip() for text in texts or () for t in text.split(",") if t.strip()] or None


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="hil_companion", description="Run an algorithm under test (CUT) against a hardware-in-the-loop bench."
    )
    made.add_argument("cut", metavar="NAME", help=", ".join(SHIPPED) + ", or MODULE:NAME of your own")
    made.add_argument("--connect", required=True, metavar="ADDR", help="tcp://HOST:PORT or ipc://FILE")
    made.add_argument("--name", help="how the bench calls this client; default the CUT's name")
    made.add_argument("--topics", action="append", metavar="A,B", help="what to receive, shell patterns: front/*,imu")
    made.add_argument("--key", metavar="FILE", help="this client's secret key")
    made.add_argument("--bench-key", metavar="FILE", help="the bench's public key")
    made.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of the CUT")
    made.add_argument("--control", action="store_true", help="ask to command, for a CUT that does not by itself")
    made.add_argument("--hold", action="store_true", help="what it desires is flown as it stands, not carried on")
    made.add_argument("--credit", type=int, default=1, help="frames on the way at once; default 1")
    made.add_argument("--no-shared-memory", action="store_true", help="even where the bench is on this machine")
    made.add_argument("--wait", type=float, default=DEFAULT_WAIT_S, metavar="S", help="for the bench to be there")
    made.add_argument("--reconnect", type=float, default=math.inf, metavar="S", help="after a loss; default for ever")
    return made


def _stop(number: int, frame: Any) -> None:  # noqa: ARG001
    raise KeyboardInterrupt


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status: 0 ended, 2 wrong options, 3 error."""
    # As Ctrl-C, so that the bench hears a bye: what a service manager sends, and a script that hides SIGINT from us.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    given = parser().parse_args(arguments)
    if math.isnan(given.wait) or math.isnan(given.reconnect):
        to_stderr("error: --wait and --reconnect are seconds")
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
