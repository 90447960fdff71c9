"""A second host on this machine: a network namespace behind a pair of virtual Ethernet devices with a shaped wire.

    with SecondHost() as other:
        subprocess.run(other.command(["ping", "-c1", other.near]))      # runs over there

Both ends send at no more than 1 Gbit/s. The delay of 0.2 ms each way needs netem, a part of the kernel that not every
machine has; without it the wire has its rate only, and `shape` says so. Needs root, `ip` and `tc`. Everything is gone
after `close`, whatever failed before: the devices go with their namespace.
"""

from __future__ import annotations

import os
import secrets
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress

from hil.signals.errors import PortNotFound

RATE_MBIT = 1000
DELAY_MS = 0.2
_BURST = "128kb"  # of tbf: more than the greatest segment that the kernel hands over at once
_LIMIT_S = 10.0


def why_not() -> str | None:
    """What is missing to make a second host; None if nothing is."""
    if os.geteuid() != 0:
        return "only root may make network namespaces"
    missing = [tool for tool in ("ip", "tc") if shutil.which(tool) is None]
    if missing:
        return f"no {' and no '.join(missing)} (package iproute2)"
    name = f"hil-{secrets.token_hex(3)}"
    try:
        _do("ip", "netns", "add", name)
        _do("ip", "netns", "delete", name)
    except PortNotFound as error:
        return f"no network namespaces here ({error})"
    return None


class SecondHost:
    """`near`: this side's address on the wire between. `far`: the other's. Open when made."""

    def __init__(self) -> None:
        tag = secrets.token_hex(3)
        self._name, self._ends = f"hil-{tag}", (f"hil-{tag}-n", f"hil-{tag}-f")
        # Of 198.18.0.0/15, which RFC 2544 sets aside for measurements between network devices.
        third, fourth = 1 + secrets.randbelow(254), 4 * secrets.randbelow(60)
        self.near, self.far = f"198.18.{third}.{fourth + 1}", f"198.18.{third}.{fourth + 2}"
        try:
            self._make()
        except BaseException:
            self.close()
            raise

    def _make(self) -> None:
        here, there = self._ends
        _do("ip", "netns", "add", self._name)
        _do("ip", "link", "add", here, "type", "veth", "peer", "name", there)
        _do("ip", "link", "set", there, "netns", self._name)
        for address, device, where in ((self.near, here, ()), (self.far, there, self.command(()))):
            _do(*where, "ip", "address", "add", f"{address}/30", "dev", device)
            _do(*where, "ip", "link", "set", device, "up")
        _do(*self.command(()), "ip", "link", "set", "lo", "up")
        self.delayed = self._shape("netem", "delay", f"{DELAY_MS}ms", "rate", f"{RATE_MBIT}mbit", "limit", "10000")
        if not self.delayed and not self._shape("tbf", "rate", f"{RATE_MBIT}mbit", "burst", _BURST, "latency", "50ms"):
            raise PortNotFound(here, "the kernel can shape no wire (neither netem nor tbf)")

    def _shape(self, *discipline: str) -> bool:
        """Whether the kernel has it. On both ends or on none."""
        here, there = self._ends
        for device, where in ((here, ()), (there, self.command(()))):
            try:
                _do(*where, "tc", "qdisc", "replace", "dev", device, "root", *discipline)
            except PortNotFound:
                return False
        return True

    @property
    def shape(self) -> str:
        """Of the wire, for people."""
        delay = f"{DELAY_MS:g} ms each way" if self.delayed else "no delay: this kernel has no netem"
        return f"{RATE_MBIT / 1000:g} Gbit/s, {delay}"

    def command(self, argv: Sequence[str]) -> tuple[str, ...]:
        """To run this over there."""
        return ("ip", "netns", "exec", self._name, *argv)

    def close(self) -> None:
        """May be called twice."""
        for words in (("ip", "link", "delete", self._ends[0]), ("ip", "netns", "delete", self._name)):
            with suppress(PortNotFound):
                _do(*words)

    def __enter__(self) -> SecondHost:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _do(*words: str) -> None:
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PortNotFound("second host", f"{' '.join(words)}: {error}") from error
    if done.returncode != 0:
        raise PortNotFound("second host", f"{' '.join(words)}: {done.stderr.strip() or done.returncode}")
