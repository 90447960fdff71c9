"""Processes of the simulators that `hil bench gym` compares.

Each simulator runs in a process of its own, on the same core as the others: PyFlyt needs numpy 1, Crazyflow has to be
imported before scipy, and both bring libraries with threads. The processes measure in turns of half a second.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from signals.errors import HilError

OWN = "this project"
_FOLDER = Path(__file__).parent / "simulators"
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}


class SimulatorError(HilError):
    """Simulator that cannot be imported, or failed."""


@dataclass(frozen=True)
class Simulator:
    """Simulator and one of its models. `option`: its name for --set, whose value is the Python that has it."""

    name: str
    module: str
    model: str = ""
    option: str = ""
    install: str = ""
    action: str = "motors"  # or "attitude": a controller flies them, in this project body rates
    tolerance_m: float = 1e-9  # of this project's error

    @property
    def is_own(self) -> bool:
        """True for this project."""
        return self.module == "hil"

    def missing(self, reason: str) -> str:
        """Return a line for a simulator that was not measured."""
        venv = f"/tmp/{self.option}"  # noqa: S108 (an example in a message)
        return (
            f"{self.name}: {reason}; python -m venv {venv} && {venv}/bin/pip install {self.install}, "
            f"then --set {self.option}={venv}/bin/python"
        )


OWN_10_MS = Simulator(OWN, "hil", model="10 motors")
OWN_25_MS = Simulator(OWN, "hil", model="25 motors")
OWN_RATES = Simulator(f"{OWN}, rates", "hil", model="10 rates", action="attitude")
OWN_COARSE = Simulator(f"{OWN}, rates, to 0.1 mm", "hil", "10 rates 1e-4", action="attitude", tolerance_m=1e-4)
ROTORPY = Simulator("RotorPy", "rotorpy", "rk4", "rotorpy", "'rotorpy[batched,learning]==3.0.0'")
PYFLYT = Simulator("PyFlyt", "pyflyt", "bullet", "pyflyt", "PyFlyt==0.29.0")
_CRAZYFLOW = ("crazyflow", "crazyflow==0.4.0")
CRAZYFLOW_FITTED = Simulator("Crazyflow so_rpy", "crazyflow", "so_rpy", *_CRAZYFLOW, "attitude")
CRAZYFLOW_RIGID = Simulator("Crazyflow first_principles", "crazyflow", "first_principles", *_CRAZYFLOW, "attitude")
PEERS = (ROTORPY, PYFLYT, CRAZYFLOW_FITTED, CRAZYFLOW_RIGID)


class SimulatorProcess:
    """Process of a simulator. A context that ends it. Raises SimulatorError if it cannot be opened."""

    def __init__(self, simulator: Simulator, *, worlds: int, python: str | None) -> None:
        """`python`: interpreter that has the simulator; None: this one."""
        self.simulator, self.worlds = simulator, worlds
        try:
            self._process = subprocess.Popen(
                [python or sys.executable, str(_FOLDER)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env={**os.environ, **_ONE_THREAD},
            )
        except OSError as error:
            raise SimulatorError(f"{python}: cannot be started ({error.strerror or error})") from error
        try:
            opened = self._ask({"open": simulator.module, "worlds": worlds, "model": simulator.model})
        except SimulatorError:
            self.close()
            raise
        self.decision_s: float = opened["decision_s"]
        self.versions: Mapping[str, str] = opened["versions"]

    def measure(self, seconds: float) -> dict[str, float]:
        """Step for some processor time; return the numbers of steps and seconds."""
        return self._ask({"measure_s": seconds})

    def error(self) -> dict[str, Any]:
        """Fly the manoeuvre; return the greatest error of position [m] and how it was found."""
        return self._ask({"error": True})

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except OSError:
            line = ""
        if not line:
            raise SimulatorError(f"{self.simulator.name}: its process ended with status {process.wait()}")
        try:
            answer: dict[str, Any] = json.loads(line)
        except ValueError:
            text = f"{self._process.args[0]!r} answers {line.strip()!r}; give the Python that has it"  # type: ignore[index]
            raise SimulatorError(f"{self.simulator.name}: {text}") from None
        if "failed" in answer:
            raise SimulatorError(f"{self.simulator.name}: {answer['failed']}")
        return answer

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def __enter__(self) -> SimulatorProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
