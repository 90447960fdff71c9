"""A second host on this machine for link benchmarks: a network namespace behind a shaped virtual Ethernet pair.

The devices have a rate of 1 Gbit/s and, where the kernel has netem, a delay of 0.2 ms each way. Making them needs root,
`ip` and `tc`.
"""

from __future__ import annotations

import os
import secrets
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

from signals.errors import PortNotFound

_RATE_MBIT, _DELAY_MS = 1000, 0.2


class Host(NamedTuple):
    """A second host. `command` is the prefix of a command line that runs there."""

    bench_address: str  # of this side, as seen from the second host
    command: tuple[str, ...]
    delayed: bool  # False: the connection has a limited rate, but no added delay


@contextmanager
def second_host() -> Iterator[Host]:
    """Make a network namespace and delete it afterwards. Raises PortNotFound with the missing requirement."""
    if os.geteuid() != 0:
        raise PortNotFound("second host", "only root may make network namespaces")
    name = f"hil-{secrets.token_hex(3)}"
    bench_device, host_device, prefix = f"{name}-n", f"{name}-f", f"ip netns exec {name}"
    # RFC 2544 reserves 198.18.0.0/15 for measurements between network devices.
    block = f"198.18.{1 + secrets.randbelow(254)}"
    last = 4 * secrets.randbelow(60)
    try:
        _run(f"ip netns add {name}")
        _run(f"ip link add {bench_device} type veth peer name {host_device}")
        _run(f"ip link set {host_device} netns {name}")
        for address, device, command in ((last + 1, bench_device, ""), (last + 2, host_device, prefix)):
            _run(f"{command} ip address add {block}.{address}/30 dev {device}")
            _run(f"{command} ip link set {device} up")
        ends = ((bench_device, ""), (host_device, prefix))
        delayed = True
        try:
            for device, command in ends:
                netem = f"netem delay {_DELAY_MS}ms rate {_RATE_MBIT}mbit limit 10000"
                _run(f"{command} tc qdisc replace dev {device} root {netem}")
        except PortNotFound:
            delayed = False
            for device, command in ends:
                # The burst must exceed the largest segment that the kernel passes on at once.
                tbf = f"tbf rate {_RATE_MBIT}mbit burst 128kb latency 50ms"
                _run(f"{command} tc qdisc replace dev {device} root {tbf}")
        yield Host(f"{block}.{last + 1}", tuple(prefix.split()), delayed)
    finally:
        for cleanup in (f"ip link delete {bench_device}", f"ip netns delete {name}"):
            with suppress(PortNotFound):
                _run(cleanup)


def _run(command: str) -> None:
    try:
        result = subprocess.run(command.split(), capture_output=True, text=True, timeout=10.0, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PortNotFound("second host", f"{command}: {error}") from error
    if result.returncode != 0:
        raise PortNotFound("second host", f"{command}: {result.stderr.strip() or result.returncode}")
