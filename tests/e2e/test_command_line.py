"""The `hil` command in a shell: every error ends in one message and the right exit status."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hil.cli.app import run_command_line
from tests.worlds.bench_process import hil
from tests.worlds.patience import PATIENCE_S, until
from tests.worlds.run_json_schema import problems_of

ROOT = Path(__file__).resolve().parents[2]
SHORT = ["--set", "duration_s=1", "--set", "record.report=false", "--set", "autopilot.transport=loopback"]


def status_of(out: Path) -> str:
    run = json.loads((out / "run.json").read_text())
    assert problems_of(run) == []
    return run["status"]


@pytest.mark.parametrize("name", ["SIGTERM", *(pytest.param(n, marks=pytest.mark.slow) for n in ("SIGHUP", "SIGINT"))])
def test_a_signal_ends_a_run_as_error_and_leaves_no_old_result(name: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"schema": 1, "status": "PASS"}')
    command = [sys.executable, "-m", "hil.cli.entry", "run", "-q", "--out", str(tmp_path)]
    command += ["--set", "pace=1", "--set", "record.report=false"]
    bench = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        until(lambda: "Killed" in (tmp_path / "run.json").read_text())
        assert status_of(tmp_path) == "ERROR"  # from the start on, in case of kill -9
        until(lambda: any(file.stat().st_size for file in tmp_path.glob("flight.tlog")))  # it flies
        bench.send_signal(getattr(signal, name))
        _, errors = bench.communicate(timeout=PATIENCE_S)
    finally:
        bench.kill()
    assert bench.returncode == 3
    assert "Traceback" not in errors
    assert json.loads((tmp_path / "run.json").read_text())["error"]["type"] == "Interrupted"


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        *(("SIGTERM", arguments) for arguments in ("check", "view city_park", "dataset", "replay .", "run")),
        ("SIGINT", "run"),
    ],
)
def test_a_signal_before_the_work_is_one_line_and_the_status_of_an_error(
    name: str, arguments: str, tmp_path: Path
) -> None:
    # The signal comes while the command imports its modules.
    program = (
        "import os, signal, sys\n"
        "class Stop:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'hil.run' or name.startswith('hil.apps.'):\n"
        f"            sys.meta_path.remove(self); os.kill(os.getpid(), signal.{name})\n"
        "sys.meta_path.insert(0, Stop())\n"
        "from hil.cli.entry import main\n"
        f"sys.argv = ['hil', *{arguments.split()!r}]\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (done.returncode, done.stderr) == (3, f"error: stopped by {name}\n")


def test_a_signal_within_the_import_of_an_extension_is_no_defect() -> None:
    code = (
        "import os, signal\n"
        "from hil.cli import app, entry\n"
        "def load(arguments):\n"
        "    try:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    except KeyboardInterrupt:\n"
        "        raise ImportError('initialization failed')\n"
        "app.run_command_line = load\n"
        "entry.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (done.returncode, done.stderr) == (3, "error: stopped by SIGINT\n")


def test_a_defect_after_a_signal_is_told() -> None:
    code = (
        "import os, signal\n"
        "from hil.cli import app, entry\n"
        "def close(arguments):\n"
        "    try:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    except KeyboardInterrupt:\n"
        "        raise KeyError('the end of a run')\n"
        "app.run_command_line = close\n"
        "entry.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 3
    assert done.stderr.startswith("error: KeyError: 'the end of a run' (a defect of the bench")


BACKGROUND_CAMPAIGN = """
bench: null
settings: {autopilot: {transport: loopback}, duration_s: 0.1, record: {report: false}}
axes: {seed: {first: 1, count: 100000}}
"""


def cases(campaign: Path) -> int:
    file = campaign / "campaign.json"  # written every two seconds
    return json.loads(file.read_text())["cases"] if file.is_file() else 0


def test_a_campaign_in_the_background_outlives_its_terminal_and_answers_sigint(tmp_path: Path) -> None:
    """`nohup` ignores SIGHUP, and a script's shell SIGINT in what it starts in the background."""
    (tmp_path / "long.yaml").write_text(BACKGROUND_CAMPAIGN)
    words = f"{sys.executable} -m hil.cli.entry campaign {tmp_path}/long.yaml --out {tmp_path}/out --workers 1"
    script = f"nohup {words} >{tmp_path}/log 2>&1 & echo $!; wait $!; echo $?"
    with subprocess.Popen(["sh", "-c", script], cwd=ROOT, stdout=subprocess.PIPE, text=True) as shell:
        assert shell.stdout is not None
        process = int(shell.stdout.readline())
        try:
            until(lambda: cases(tmp_path / "out") > 0)
            os.kill(process, signal.SIGHUP)
            before = cases(tmp_path / "out")
            until(lambda: cases(tmp_path / "out") > before + 10)
            os.kill(process, signal.SIGINT)
            status, _ = shell.communicate(timeout=PATIENCE_S)
        except BaseException:
            os.kill(process, signal.SIGKILL)  # else it flies on after the test
            raise
        assert status == "3\n"
    assert (tmp_path / "log").read_text().endswith("error: stopped by SIGINT\n")


@pytest.mark.parametrize("name", ["SIGINT", pytest.param("SIGTERM", marks=pytest.mark.slow)])
def test_a_run_that_flies_nothing_of_its_own_ends_at_a_signal_as_at_its_end(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hil.cli.entry", "run", "-q", "--out", str(tmp_path), "--set", "mission=null"]
    command += ["--set", "pace=1", "--set", "record.report=false", "--set", "autopilot.transport=loopback"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as bench:
        until(lambda: any(file.stat().st_size for file in tmp_path.glob("flight.tlog")))
        bench.send_signal(getattr(signal, name))
        assert bench.wait(PATIENCE_S) == 0
    assert status_of(tmp_path) == "PASS"


def test_a_signal_within_a_callback_whose_exceptions_are_dropped_still_ends_the_run() -> None:
    code = (
        "import os, signal, sys, time\n"
        "from hil.cli import app\n"
        "from hil.cli import entry\n"
        "class Dropped:\n"
        "    def __del__(self):\n"
        "        os.kill(os.getpid(), signal.SIGTERM)\n"
        "        time.sleep(0.01)\n"
        "def fly(arguments):\n"
        "    Dropped()\n"
        "    time.sleep(60)\n"
        "app.run_command_line = fly\n"
        "entry.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (done.returncode, done.stderr) == (3, "error: stopped by SIGTERM\n")


def test_a_signal_after_the_command_leaves_its_status_and_threads_and_handlers_are_run() -> None:
    code = (
        "import atexit, os, signal, threading, time\n"
        "from hil.cli import app, entry\n"
        "class Late:\n"
        "    def __del__(self, kill=os.kill, own=os.getpid(), number=signal.SIGTERM):\n"
        "        kill(own, number)\n"  # while Python takes its modules apart
        "late = Late()\n"
        "atexit.register(print, 'handler')\n"
        "def fly(arguments):\n"
        "    threading.Thread(target=lambda: (time.sleep(0.2), print('thread'))).start()\n"
        "    return 1\n"
        "app.run_command_line = fly\n"
        "entry.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "thread\nhandler\n", "")


PASSES = ["run", "--set", "mission=", "--set", "duration_s=0.1", "--set", "record.report=false"]
PASSES += ["--set", "autopilot.transport=loopback"]


@pytest.mark.parametrize(
    ("broken", "arguments", "status"),
    [
        *((broken, PASSES, 0) for broken in ("reader gone", "full", "closed")),
        ("reader gone", ["check"], 0),
        ("full", ["check", "--rig", "mok"], 2),
        ("reader gone", ["--help"], 0),
    ],
)
def test_an_output_that_nobody_receives_changes_no_status(
    broken: str, arguments: list[str], status: int, tmp_path: Path
) -> None:
    if arguments is PASSES:
        arguments = [*arguments, "--out", str(tmp_path)]
    shell = {
        "reader gone": '"$@" 2>&1 | true; exit ${PIPESTATUS[0]}',
        "full": '"$@" >/dev/full 2>/dev/full',
        "closed": '"$@" <&- >&- 2>&-',
    }
    program = [sys.executable, "-m", "hil.cli.entry", *arguments]
    done = subprocess.run(
        ["bash", "-c", shell[broken], "hil", *program],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (status, "")
    if arguments[0] == "run":
        assert status_of(tmp_path) == "PASS"


def test_a_command_that_only_prints_ends_with_its_reader() -> None:
    command = [sys.executable, "-m", "hil.cli.entry", "devices", "--watch", "--json"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as watching:
        try:
            assert watching.stdout is not None
            assert watching.stdout.readline().startswith("{")
            watching.stdout.close()
            assert watching.wait(PATIENCE_S) == 0
        finally:
            watching.kill()


def test_the_digest_is_printed_whole_in_plain_ascii(tmp_path: Path) -> None:
    done = hil("run", "--out", str(tmp_path), *SHORT, env={"PYTHONIOENCODING": "ascii", "LC_ALL": "C"})
    assert done.returncode == 1, done.stderr
    assert json.loads((tmp_path / "run.json").read_text())["digest"] in done.stdout


@pytest.mark.parametrize("make", ["file", "below a file", "dangling link"])
def test_an_unusable_folder_is_an_error(make: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    if make == "dangling link":
        out.symlink_to(tmp_path / "nowhere" / "at all")
    else:
        out.write_text("a file")
    assert run_command_line(["run", "-q", "--out", str(out / "x" if make == "below a file" else out), *SHORT]) == 3
    assert "cannot be used as a folder for results" in capsys.readouterr().err


def test_a_rig_by_path_and_a_config_error_without_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command_line(["run", "-q", "--rig", str(ROOT / "rigs/mock.yaml"), *SHORT]) in (0, 1)
    assert [p.name.endswith("-mock") for p in (tmp_path / "runs").iterdir() if not p.is_symlink()] == [True]
    (tmp_path / "runs/latest").unlink()
    assert run_command_line(["run", "-q", "--rig", "../a/b c.yaml"]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_replay_never_overwrites_the_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["run", "-q", "--out", str(tmp_path), *SHORT]) == 1
    before = (tmp_path / "run.mcap").read_bytes()
    assert run_command_line(["replay", str(tmp_path), "--out", str(tmp_path)]) == 3
    assert "name another folder" in capsys.readouterr().err
    assert (tmp_path / "run.mcap").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["run", "--nonsense"], 2),
        (["nonsense"], 2),
        (["bench", "nonsense"], 2),
        (["--help"], 0),
        (["replay", "nowhere at all"], 2),
        (["run", "--out", ""], 2),
        (["run", "--out="], 2),
        (["view", " "], 2),
        (["check", "--rig", "\udcff"], 2),
    ],
)
def test_usage_errors(arguments: list[str], status: int) -> None:
    assert run_command_line(arguments) == status


def test_a_renderer_named_in_the_environment_is_ignored() -> None:
    assert hil("check", env={"MUJOCO_GL": "osmesa"}).returncode == 0


def test_an_internal_defect_is_an_error_with_a_message() -> None:
    script = "import hil.cli.app, hil.cli.entry; hil.cli.app.run_command_line = lambda a: 1 / 0; hil.cli.entry.main()"
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert ended.returncode == 3
    assert ended.stderr.startswith("error: ZeroDivisionError")
    assert "Traceback" not in ended.stderr
