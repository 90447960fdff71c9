"""Past runs whose files are damaged or hostile: marked as broken, without an effect on the others."""

from __future__ import annotations

import io
import json
import os
import random
import zipfile
from pathlib import Path
from typing import Any

import pytest
from starlette.responses import JSONResponse

from hil.apps.dash.past.archive import zipped
from hil.apps.dash.past.past_runs import PastRuns
from hil.run.recorder.recorder import Recorder
from hil.run.report.run_folder import locked_folder
from signals.errors import RecordingError
from tests.worlds.synthetic_flight import TICK_NS, fly, make_flight

GOOD = {"status": "PASS", "digest": "ab", "mission": {"file": "a.plan"}, "error": None}
HOSTILE = [
    "",
    "{",
    "[]",
    "7",
    "[" * 100_000,
    '{"status": "PASS", "sim_s": NaN}',
    '{"status": "PASS", "sim_s": "long"}',
    '{"status": "PASS", "digest": 7}',
    '{"status": "PASS", "mission": "a.plan"}',
    '{"status": "PASS", "mission": {"file": ["a"]}}',
    '{"status": "PASS", "error": ["a"]}',
    '{"status": "PASS", "by_hand": 5}',
    '{"status": "PASS", "rig": "\\ud800"}',
    '{"status": "PASS", "seed": ' + "9" * 5000 + "}",
    b"\xff\xfe",
]


def runs_folder(folder: Path, **contents: Any) -> PastRuns:
    for name, content in contents.items():
        (folder / name).mkdir()
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name / "run.json").write_bytes(data)
    return PastRuns(folder)


@pytest.mark.parametrize("content", HOSTILE, ids=lambda content: repr(content[:40]))
def test_a_damaged_run_json_hides_no_other_run(tmp_path: Path, content: Any) -> None:
    past = runs_folder(tmp_path, good=json.dumps(GOOD), hostile=content)
    listed = {run["name"]: run for run in past.listed()}
    JSONResponse(list(listed.values()))
    assert listed["good"]["broken"] is None
    assert listed["good"]["mission"] == "a.plan"
    assert "hostile/run.json: damaged" in listed["hostile"]["broken"]
    with pytest.raises(RecordingError, match="damaged"):
        past.summary("hostile")


def test_a_named_pipe_is_not_read(tmp_path: Path) -> None:
    past = runs_folder(tmp_path, good=json.dumps(GOOD))
    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe" / "run.json")
    os.mkfifo(tmp_path / "good" / "run.mcap")
    assert [run["name"] for run in past.listed()] == ["good"]


def test_a_damaged_recording_is_named_and_marked(tmp_path: Path) -> None:
    past = runs_folder(tmp_path, good=json.dumps(GOOD))
    recorder = Recorder(tmp_path / "good", mcap=True, tlog=False, tick_ns=TICK_NS)
    fly(recorder, make_flight(100))
    recorder.close("PASS")
    path = tmp_path / "good" / "run.mcap"
    whole = path.read_bytes()
    assert past.track("good")["t"]
    assert past.listed()[0]["broken"] is None
    generator = random.Random(1)
    refused = 0
    for n in range(150):
        data = bytearray(whole)
        for _ in range(1 + n % 5):
            data[generator.randrange(len(data) if n % 3 else 400)] = generator.randrange(256)
        path.write_bytes(data)
        os.utime(path, ns=(n, n))
        try:
            JSONResponse(past.track("good"))
        except RecordingError:
            refused += 1
            assert "damaged" in past.listed()[0]["broken"] or "not an MCAP" in past.listed()[0]["broken"]
        past.moments.at("good", 10**9, ["front/rgb", "lidar/points"])
    assert refused > 50


KILLED = GOOD | {"status": "ERROR", "error": {"type": "Killed", "message": "..."}}


def test_a_run_that_goes_on_is_listed_as_running(tmp_path: Path) -> None:
    past = runs_folder(tmp_path, a=json.dumps(KILLED), b=json.dumps(KILLED), c=json.dumps(GOOD))
    with locked_folder(tmp_path / "a"), locked_folder(tmp_path / "c"):
        listed = {run["name"]: (run["status"], run["error"]) for run in past.listed()}
        assert listed == {"a": ("running", None), "b": ("ERROR", "Killed"), "c": ("PASS", None)}
        summary = past.summary("a")
        assert summary is not None
        assert (summary["status"], summary["error"]) == ("running", None)
    assert {run["name"]: run["status"] for run in past.listed()} == {"a": "ERROR", "b": "ERROR", "c": "PASS"}


def test_a_run_is_one_zip_of_its_own_files(tmp_path: Path) -> None:
    past = runs_folder(tmp_path, good=json.dumps(GOOD))
    folder = past.folder("good")
    assert folder is not None
    (folder / "autopilot").mkdir()
    (folder / "autopilot/log.bin").write_bytes(bytes(range(256)) * 20_000)  # several pieces
    secret = tmp_path / "secret.txt"
    secret.write_text("not of the run")
    (folder / "link.txt").symlink_to(secret)
    (folder / "away").symlink_to(tmp_path)
    pieces = list(zipped(folder))
    assert len(pieces) > 4
    with zipfile.ZipFile(io.BytesIO(b"".join(pieces))) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["good/autopilot/log.bin", "good/run.json"]
        assert archive.read("good/run.json") == (folder / "run.json").read_bytes()
        assert archive.read("good/autopilot/log.bin") == (folder / "autopilot/log.bin").read_bytes()


def test_a_recording_that_is_read_does_not_keep_the_process_from_ending(tmp_path: Path) -> None:
    past = runs_folder(tmp_path, good=json.dumps(GOOD))
    recorder = Recorder(tmp_path / "good", mcap=True, tlog=False, tick_ns=TICK_NS)
    fly(recorder, make_flight(100))
    recorder.close("PASS")
    assert past.track("good")["t"]
    other = PastRuns(tmp_path)
    other.end()
    with pytest.raises(RecordingError, match="the dashboard ends"):
        other.track("good")
