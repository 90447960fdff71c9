"""Reports of clients: validated by the client and the bench."""

from __future__ import annotations

import math
from typing import Any

import msgpack
import pytest

from firmware_bridge.codecs.companion import Done, decode_client, report_from_map
from firmware_bridge.codecs.errors import CodecError
from tests.worlds.scripted_bench import CLIENT

from hil_companion.link import protocol  # isort: skip
from hil_companion.catalog import make_cut  # isort: skip
from hil_companion.cuts.explore import Explore  # isort: skip
from hil_companion.errors import CutError, OptionError  # isort: skip
from hil_companion.link.protocol import checked_report  # isort: skip

assert CLIENT
TIMES: dict[str, Any] = {"t_received_ns": 1, "t_sent_ns": 2, "t2_ns": 0, "desired": None, "finished": False}
REPORT = {"outcome": "goal", "left_m": 0.25, "replans": 7, "sure": True}


def test_a_report_crosses_the_wire_as_it_is() -> None:
    message = decode_client(protocol.message("done", frame=3, report=REPORT, **TIMES))
    assert isinstance(message, Done)
    assert message.report == REPORT
    silent = decode_client(protocol.message("done", frame=3, **TIMES))
    assert isinstance(silent, Done)
    assert silent.report is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"a b": 1},
        {"": 1},
        {"x": math.nan},
        {"x": math.inf},
        {"x": [1]},
        {"x": None},
        {"x": {"y": 1}},
        {"x": 2**60},
        {f"k{n}": n for n in range(33)},
    ],
)
def test_invalid_reports_are_refused_on_both_sides(wrong: dict[str, Any]) -> None:
    with pytest.raises(CutError):
        checked_report(wrong)
    with pytest.raises(CodecError):
        decode_client(protocol.message("done", frame=3, report=wrong, **TIMES))


def test_long_texts_are_cut_by_the_client_and_refused_by_the_bench() -> None:
    assert len(checked_report({"why": "x" * 500})["why"]) == 200
    with pytest.raises(CodecError):
        report_from_map({"why": "x" * 201})
    with pytest.raises(CodecError):
        report_from_map("goal")
    assert msgpack.unpackb(protocol.message("done", frame=1, report={}, **TIMES))["report"] == {}


def test_explore_refuses_invalid_options() -> None:
    cut = make_cut("explore", ["localiser=truth", "camera=front/rgb"])
    assert isinstance(cut, Explore)
    assert cut.topics == ("imu", "gps", "baro", "lidar", "front/rgb", "truth")
    assert cut.report == {}
    for wrong, words in (
        ("localiser=odometry", "slam, truth"),
        ("goal=[1]", "2 or 3 numbers"),
        ('goal=["a", 1]', "a number is needed"),
        ("start=3", "4 numbers"),
        ('flight={"spede_mps": 1}', "spede_mps"),
        ('flight={"speed_mps": -1}', "speed_mps"),
        ("flight=3", "a mapping"),
    ):
        with pytest.raises(OptionError, match=words):
            make_cut("explore", [wrong])
