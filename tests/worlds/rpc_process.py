"""The RPC server of `hil airsim` without a world, in a process of its own whose memory can be measured."""

from __future__ import annotations

import asyncio
import resource
import subprocess
import sys
from pathlib import Path

from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]


class RpcProcess:
    """`with RpcProcess() as server:` answers `ping`, `count` (elements of an array) and `zeros` (that many bytes)."""

    def __enter__(self) -> RpcProcess:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.worlds.rpc_process"],
            cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline())
        self._first_bytes = self._peak_bytes()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def _peak_bytes(self) -> int:
        status = Path(f"/proc/{self._process.pid}/status").read_text()
        return next(int(line.split()[1]) << 10 for line in status.splitlines() if line.startswith("VmHWM"))

    def most_bytes(self) -> int:
        """Return the most memory beyond that of its start which the process has had since the last call."""
        peak = self._peak_bytes()
        Path(f"/proc/{self._process.pid}/clear_refs").write_text("5")  # VmHWM begins anew
        return peak - self._first_bytes

    def limit_descriptors(self, most: int) -> None:
        """Let the process open no more files than this."""
        _, hard = resource.prlimit(self._process.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(self._process.pid, resource.RLIMIT_NOFILE, (most, hard))

    def end(self) -> str:
        """End the process and return all that it has printed."""
        self._process.terminate()
        text, _ = self._process.communicate(timeout=PATIENCE_S)
        return text


async def _serve() -> None:
    from hil.apps.airsim.rpc.arguments import COUNT, Type
    from hil.apps.airsim.rpc.methods import MethodTable, Parameter, method
    from hil.apps.airsim.rpc.server import RpcServer

    def say(text: str) -> None:
        print(text[:300], flush=True)

    table = MethodTable(
        [
            method("ping", lambda: True),
            method("count", len, Parameter("items", Type("array", lambda value: value))),
            method("zeros", bytes, Parameter("n", COUNT)),
        ]
    )
    print(await RpcServer(table, say).start("127.0.0.1", 0), flush=True)
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(_serve())
