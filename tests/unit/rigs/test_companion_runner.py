"""The client's runner and command: reconnection after a loss, failing CUTs, the end in one line."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.patience import PATIENCE_S
from tests.worlds.scripted_bench import (
    CLIENT,
    END,
    Bench,
    frame,
    running,
    welcome,
)

from hil_companion import Desired, Frame  # isort: skip
from hil_companion.runner import END_STATUS, ERROR_STATUS, OPTION_STATUS, run  # isort: skip


class Counter:
    """A CUT that records its sessions and frames."""

    finished = False

    def __init__(self) -> None:
        self.sessions: list[str] = []
        self.frames: list[int] = []
        self.stopped = 0

    def start(self, welcome: Any) -> None:
        self.sessions.append(welcome.session)

    def __call__(self, given: Frame) -> Desired:
        self.frames.append(given.frame)
        self.finished = given.frame == 3
        return Desired(v_W=(0.0, 0.0, float(given.frame)))

    def stop(self) -> None:
        self.stopped += 1


def run_quietly(cut: Any, address: str, **options: Any) -> tuple[int, list[str]]:
    said: list[str] = []
    return run(cut, address, **{"name": "test", "wait_s": 5.0, "control": True, "say": said.append, **options}), said


def test_the_runner_comes_back_after_a_loss_and_starts_a_cut_once_a_session(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/bench"
    cut = Counter()
    result: list[Any] = []
    thread = threading.Thread(target=lambda: result.append(run_quietly(cut, address)), daemon=True)

    def serve(numbers: list[int], *, last: bool = False, **changes: Any) -> Any:
        def script(bench: Bench) -> None:
            if bench_number > 1:  # a bench that has not noticed the loss yet
                identity, _ = bench.receive("hello")
                bench.send(identity, {"k": "refused", "code": "name", "text": "is taken"})
            client = bench.greet(**changes)
            for n in numbers:
                bench.send(client, frame(n))
                assert bench.receive("done")[1]["desired"] == {"v_W": [0.0, 0.0, float(n)]}
            if last:
                bench.send(client, END)

        return script

    bench_number = 1
    with running(serve([0, 1]), address) as bench:
        thread.start()
    assert bench.of_kind("hello")[0]["schema"] is None
    bench_number = 2
    with running(serve([2]), address) as bench:
        pass
    assert {h["schema"] for h in bench.of_kind("hello")} == {"a" * 16}
    with running(serve([3], last=True, session="f" * 16), address) as bench:
        thread.join(PATIENCE_S)
    assert bench.of_kind("done")[-1]["finished"] is True
    status, said = result[0]
    assert status == END_STATUS
    assert cut.frames == [0, 1, 2, 3]
    assert cut.sessions == [welcome()["session"], "f" * 16]
    assert cut.stopped == 1
    assert sum("connecting again" in line for line in said) == 2


def test_one_that_the_bench_dropped_comes_back() -> None:
    def script(bench: Bench) -> None:
        client = bench.greet()
        bench.send(client, {"k": "end", "status": "dropped", "text": "no answer within 1 s"})
        client = bench.greet()
        bench.send(client, frame(3))
        bench.receive("done")
        bench.send(client, END)

    cut = Counter()
    with running(script) as bench:
        status, said = run_quietly(cut, bench.address)
    assert (status, cut.frames, cut.sessions) == (END_STATUS, [3], [welcome()["session"]])
    assert any("no answer within 1 s" in line for line in said)


def test_a_loss_ends_the_runner_where_it_may_not_come_back() -> None:
    def script(bench: Bench) -> None:
        bench.greet()
        bench.socket.close()

    with running(script) as bench:
        status, said = run_quietly(Counter(), bench.address, reconnect_s=0)
    assert status == ERROR_STATUS
    assert "the connection was lost" in said[-1]


class AlwaysFinished:
    def __call__(self, given: Frame) -> None:
        return None

    def finished(self) -> bool:
        return False


def with_attributes(**attributes: Any) -> Any:
    cut = Counter()
    vars(cut).update(attributes)
    return cut


@pytest.mark.parametrize(
    ("cut", "words"),
    [
        (with_attributes(report=[1, 2]), "a mapping of names to values or None, not a list"),
        (with_attributes(report=len), "not a builtin_function_or_method: use an attribute"),
        (AlwaysFinished(), "`finished` of the CUT is a method"),
        (lambda f: 1 / 0, "the CUT failed: ZeroDivisionError"),
        (lambda f: (1, 2, 3), "a Desired or None, not tuple"),
        (lambda f: Desired(p_W=(0, 0, math.nan)), "finite"),
    ],
)
def test_a_cut_that_fails_is_told_in_one_line_and_says_bye(cut: Any, words: str) -> None:
    def script(bench: Bench) -> None:
        bench.send(bench.greet(), frame(0))
        assert bench.receive("bye")[1]["reason"] == "CutError"

    with running(script) as bench:
        status, said = run_quietly(cut, bench.address)
    assert status == ERROR_STATUS
    assert words in said[-1]
    assert "\n" not in said[-1]


def test_the_command_ends_with_a_bye_when_it_is_told_to() -> None:
    def script(bench: Bench) -> None:
        bench.send(bench.greet(), frame(0))
        bench.receive("done")
        process.send_signal(signal.SIGTERM)
        bench.receive("bye")

    with running(script) as bench:
        environment = {**os.environ, "PYTHONPATH": str(CLIENT)}
        command = [sys.executable, "-m", "hil_companion", "echo", "--connect", bench.address]
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        assert process.wait(PATIENCE_S) == END_STATUS
        assert process.stderr is not None
        assert "stopped after" in process.stderr.read()


@pytest.mark.parametrize(
    "arguments",
    [["ehco"], ["waypoints", "--set", "sped=3"], ["waypoints", "--set", "speed_mps=0"], ["echo", "--set", "x"]],
)
def test_the_command_names_what_is_wrong(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    from hil_companion.command import start

    assert start(arguments[0], "tcp://127.0.0.1:1", settings=arguments[2:], wait_s=0.1) == OPTION_STATUS
    assert capsys.readouterr().err.startswith("error: ")


def test_the_bench_s_command_can_hold_what_a_client_desires(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hil.cli.app import run_command_line

    (tmp_path / "hovering_cut.py").write_text(
        "from hil_companion import Desired\ndef hover(frame):\n    return Desired(p_W=(0, 0, 2), v_W=(1, 0, 0))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))

    def script(bench: Bench) -> None:
        client = bench.greet(control=True)
        bench.send(client, frame(0))
        bench.receive("done")
        bench.send(client, END)

    for flags, hold in (([], False), (["--hold"], True)):
        with running(script) as bench:
            command = ["companion", "hovering_cut:hover", "--connect", bench.address, "--topics", "imu,gps"]
            assert run_command_line([*command, "--control", *flags]) == END_STATUS
        assert bench.of_kind("hello")[0]["topics"] == ["imu", "gps"]
        assert bench.of_kind("done")[0]["desired"].get("hold", False) is hold
