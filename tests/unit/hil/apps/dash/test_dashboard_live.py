"""The run's side of the dashboard: sticks that are released, and a connection that never waits."""

from __future__ import annotations

import socket
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from firmware_bridge.manual.sticks import NEUTRAL, Sticks
from hil.run.feed.live_run import LiveRun
from hil.run.feed.live_vehicle import LiveVehicle
from hil.run.feed.messages import MAX_MESSAGE, Unpacker, packed
from hil.run.feed.page_sticks import REQUESTS, PageSticks, page_buttons
from hil.run.feed.payloads import frame_streams, payload_array
from hil.run.feed.server_connection import ServerConnection
from hil.run.report.channel_images import channel_image
from signals.classes import Classes
from signals.samples import ImageSample, PointCloudSample
from tests.worlds.simulated_time import SimulatedTime

MS = 1_000_000


def test_sticks_count_only_while_the_page_repeats_them() -> None:
    clock = SimulatedTime()
    sticks = PageSticks(clock)
    assert sticks.poll().held is False
    sticks.move({"held": True, "axes": [0.5, -2.0, 0.0, 1.0]})
    state = sticks.poll()
    assert (state.sticks, state.held) == (Sticks(0.5, -1.0, 0.0, 1.0), True)
    clock.now_ns += 399 * MS
    sticks.listened()
    assert sticks.poll().held is True
    clock.now_ns += 2 * MS  # nothing came for 0.4 s: the page is gone, or hidden
    sticks.listened()
    state = sticks.poll()
    assert (state.sticks, state.held) == (NEUTRAL, False)
    # Letting go acts at once.
    sticks.move({"held": True, "axes": [1, 1, 1, 1]})
    sticks.move({"held": False, "axes": [1, 1, 1, 1]})
    assert sticks.poll() == (NEUTRAL, False, frozenset())


def test_a_slow_tick_does_not_release_the_switch_while_messages_wait() -> None:
    clock = SimulatedTime()
    sticks = PageSticks(clock)
    sticks.move({"held": True, "axes": [1, 0, 0, 0]})
    clock.now_ns += 900 * MS  # a tick of a loaded machine, in which nobody reads what the page repeats
    assert sticks.held
    assert sticks.poll() == (Sticks(1.0, 0.0, 0.0, 0.0), True, frozenset())
    sticks.move({"held": True, "axes": [1, 0, 0, 0]})  # the messages that have waited
    sticks.listened()
    assert sticks.held
    clock.now_ns += 401 * MS
    sticks.listened()  # nothing has waited: the page is gone
    assert not sticks.held


def test_sticks_are_released_with_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = socket.socketpair()
    clock = SimulatedTime()
    live = LiveRun(ours, clock_ns=clock)
    vehicle = live.vehicle()
    monkeypatch.setattr(vehicle, "extend_trail", lambda: None)  # it has not flown
    vehicle.sticks.move({"held": True, "axes": [1, 0, 0, 0]})
    live._poll(0)
    assert vehicle.sticks.held
    theirs.close()
    live._poll(0)
    assert not vehicle.sticks.held


@pytest.mark.parametrize("axes", [None, [1.0], ["1", 0, 0, 0], [float("nan"), 0, 0, 0], [True, 0, 0, 0], "abcd"])
def test_invalid_sticks_are_ignored(axes: Any) -> None:
    sticks = PageSticks(SimulatedTime())
    sticks.move({"held": True, "axes": axes})
    assert sticks.poll().sticks == NEUTRAL
    sticks.move({"held": "yes", "axes": [1, 1, 1, 1]})
    assert sticks.poll().held is False


def test_a_button_is_one_press() -> None:
    clock = SimulatedTime()
    sticks = PageSticks(clock)
    buttons = page_buttons({"position": (3.0, 0.0), "mission": (4.0, 4.0)})
    sticks.move({"held": True, "axes": [0, 0, 0, 0], "ask": "mission"})
    (number,) = sticks.poll().pressed
    assert buttons.modes[number] == "mission"
    assert set(buttons.modes.values()) == {"position", "mission"}
    sticks.move({"held": True, "axes": [0, 0, 0, 0], "ask": "self-destruct"})
    clock.now_ns += 251 * MS
    sticks.listened()
    assert sticks.poll().pressed == frozenset()
    assert REQUESTS[buttons.arm - 1] == "arm"
    assert REQUESTS[buttons.disarm - 1] == "disarm"


def test_a_server_that_does_not_read_does_not_block_the_run() -> None:
    ours, theirs = socket.socketpair()
    end = ServerConnection(ours)
    big = {"kind": "state", "data": b"x" * 8_000_000}
    end.write(big)  # far more than the socket takes
    assert end.busy
    end.push()
    assert not end.lost
    unpacker, got = Unpacker(), []
    while not got:
        end.push()
        got = unpacker.feed(theirs.recv(1 << 20))
    assert got == [big]
    assert not end.busy
    theirs.close()
    end.write({"kind": "state"})
    end.push()
    assert end.read() == []
    assert end.lost


def test_messages_are_decoded_from_pieces_of_any_size() -> None:
    data = packed({"kind": "a", "n": 1}) + packed({"kind": "b"})
    unpacker = Unpacker()
    assert [m for k in range(len(data)) for m in unpacker.feed(data[k : k + 1])] == [
        {"kind": "a", "n": 1},
        {"kind": "b"},
    ]
    assert unpacker.feed(b"\x07\xc0") == []  # no messages of this format
    with pytest.raises(ValueError, match="bytes"):
        unpacker.feed(b"\xc6\xff\xff\xff\xff" + bytes(MAX_MESSAGE))


def test_a_frame_is_sent_once_and_only_on_request() -> None:
    depth = np.arange(12, dtype=np.float32).reshape(3, 4)
    unit = (1.0, 0.0, 0.0, 0.0)
    image = ImageSample(7, 5, 6, (0.0, 0.0, 1.0), unit, {"depth": depth})
    empty = np.zeros(0, np.float32)
    cloud = PointCloudSample(
        3, 5, 6, (0.0, 0.0, 1.0), unit, np.ones((9, 3), np.float32), empty, empty, empty, empty, empty
    )
    latest = {"front": image, "lidar": cloud}
    sent: dict[str, int] = {}
    assert frame_streams(latest, [], sent) == {}
    made = frame_streams(latest, ["front/depth", "lidar/points", "front/rgb", "gone/rgb", "front"], sent)
    assert set(made) == {"front/depth", "lidar/points"}
    assert np.array_equal(payload_array(made["front/depth"]), depth)
    assert len(made["lidar/points"]["points"]) == 9 * 3 * 4
    assert frame_streams(latest, ["front/depth"], sent) == {}


def test_a_trail_stays_short_and_keeps_its_ends() -> None:
    live = LiveVehicle("")
    for k in range(100_000):
        truth = SimpleNamespace(t_ns=200 * MS * k, p_WB=(float(k), 0.0, 1.0))
        live.run = SimpleNamespace(scheduler=SimpleNamespace(truth=truth))  # type: ignore[assignment]
        live.extend_trail()
    assert 700 <= len(live._trail) <= 1500
    assert live._trail[0][1] == 0.0
    assert live._trail[-1][1] > 99_800.0
    gaps = {b[0] - a[0] for a, b in pairwise(live._trail)}
    assert max(gaps) <= 2 * min(gaps) + 1e-9


def test_depth_is_coloured_from_near_to_far_and_misses_are_grey() -> None:
    distances = np.array([0.5, 1.5, 11.0, 60.0, 1000.0, np.inf, np.nan], np.float32)
    array = np.repeat(distances[:, None], 16, axis=1).repeat(16, axis=0)
    _, data = channel_image("depth", array, Classes())
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[8::16, 8].astype(int)
    shares = 1.0 - np.log(np.clip(distances[:5].astype(float), 0.5, 200.0) / 0.5) / np.log(400.0)
    viridis = cv2.applyColorMap(np.rint(255.0 * shares).astype(np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0]
    assert np.abs(bgr[:5] - viridis.astype(int)).max() <= 8
    assert np.abs(bgr[5:] - 190).max() <= 2
