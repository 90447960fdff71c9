"""Process of one simulator: reads requests from its standard input and answers on its standard output, as JSON lines.

    {"open": NAME, "worlds": 1, "model": "..."}   open the simulator           -> its decision time and versions
    {"measure_s": 0.5}                            step for that long           -> steps, processor and wall time
    {"error": true}                               fly the manoeuvre            -> greatest error of position

It runs in the environment of the simulator, which has neither this project nor what it needs: `lab` is a package of
nothing but the files of this checkout.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

_LAB = Path(__file__).resolve().parents[2]
_CHUNK = 50  # steps between two looks at the clock


def _measure(simulator: Any, seconds: float) -> dict[str, float]:
    """Step for `seconds` of processor time. Resets between episodes are not counted."""
    steps, cpu_s, wall_s, reset_s = 0, 0.0, 0.0, []
    step = simulator.step
    while cpu_s < seconds:
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        ended = False
        for _ in range(_CHUNK):
            steps += 1
            ended = step()
            if ended:
                break
        cpu_s += time.process_time() - began_cpu_s
        wall_s += time.perf_counter() - began_s
        if ended:
            began_cpu_s = time.process_time()
            simulator.reset()
            reset_s.append(time.process_time() - began_cpu_s)
    return {"steps": steps, "cpu_s": cpu_s, "wall_s": wall_s, "reset_s": min(reset_s, default=0.0)}


def main() -> None:
    """Answer requests until standard input ends."""
    package = sys.modules["lab"] = ModuleType("lab")
    package.__path__ = [str(_LAB)]
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a simulator prints must not mix with the answers
    simulator: Any = None
    for line in sys.stdin:
        request = json.loads(line)
        answer: dict[str, Any] = {}
        try:
            if "open" in request:
                module = import_module(f"lab.gym.simulators.{request['open']}_simulator")
                simulator = module.Simulator(request["worlds"], request["model"])
                simulator.step()
                answer = {"decision_s": simulator.decision_s, "versions": simulator.versions}
            elif "measure_s" in request:
                answer = _measure(simulator, request["measure_s"])
            else:
                answer = simulator.error()
        except Exception as error:  # noqa: BLE001 (told to the parent, which decides)
            answer = {"failed": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
