"""`hil companion`: runs a client under test on this machine, the same as `python -m hil_companion` does elsewhere.

The client lives in `rigs/jetson`, as a package of its own that knows nothing of the bench, so that it can be copied to
a companion computer. From here it is found by that path.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hil.companion.started import use_client


def run_companion(
    cut: str,
    address: str,
    *,
    name: str | None,
    topics: Sequence[str],
    key: Path | None,
    bench_key: Path | None,
    settings: Sequence[str],
    control: bool,
    hold: bool,
    credit: int,
    shared_memory: bool,
    wait_s: float,
    reconnect_s: float,
) -> int:
    """Run it until the bench ends; the exit status is the client's own, its errors are told by itself."""
    use_client()
    from hil_companion.command import start, topic_list

    status: int = start(
        cut,
        address,
        name=name,
        topics=topic_list(topics),
        settings=settings,
        control=control,
        hold=hold,
        credit=credit,
        shared_memory=shared_memory,
        key=key,
        bench_key=bench_key,
        wait_s=wait_s,
        reconnect_s=reconnect_s,
    )
    return status
