"""The mission protocol of the mock: valid, lost, duplicated and invalid messages."""

import math

import pytest

from firmware_bridge.mock_pixhawk.ids import MissionResult as R
from tests.worlds.mock_pixhawk_world import messages, texts

LAT, LON = 473_977_420, 85_455_940
UNKNOWN = 2**31 - 1


def item(seq, command=16, *, frame=6, params=(0.0, 0.0, 0.0, math.nan), x=LAT, y=LON, z=10.0, **changes):
    fields = {
        "target_system": 1,
        "target_component": 1,
        "seq": seq,
        "frame": frame,
        "command": command,
        "current": 0,
        "autocontinue": 1,
        "param1": params[0],
        "param2": params[1],
        "param3": params[2],
        "param4": params[3],
        "x": x,
        "y": y,
        "z": z,
        "mission_type": 0,
    }
    return fields | changes


def plan(count=5):
    return [item(0, 22), *(item(k, x=LAT + 100 * k) for k in range(1, count))]


def count(world, n, kind=0):
    world.send("MISSION_COUNT", target_system=1, target_component=1, count=n, mission_type=kind)


def upload(world, items, *, limit_s=8.0, lose=lambda seq, attempt: False):
    """Serve requests like a ground station until the acknowledgement; returns its result."""
    count(world, len(items))
    attempts = {}
    for _ in range(round(limit_s * 250)):
        frames = world.step()
        for request in messages(frames, "MISSION_REQUEST_INT"):
            attempts[request.seq] = attempts.get(request.seq, 0) + 1
            if not lose(request.seq, attempts[request.seq]):
                world.send("MISSION_ITEM_INT", **items[request.seq])
        acks = messages(frames, "MISSION_ACK")
        if acks:
            assert len(acks) == 1
            return acks[0].type
    raise AssertionError("no acknowledgement")


def stored(world):
    return [(i.seq, i.command, i.lat_degE7) for i in world.autopilot.navigator.items]


def expected(items):
    return [(i["seq"], i["command"], i["x"]) for i in items]


def test_upload_then_download_gives_the_same_items(world):
    items = plan()
    assert upload(world, items) == R.ACCEPTED
    assert stored(world) == expected(items)
    world.send("MISSION_REQUEST_LIST", target_system=1, target_component=1, mission_type=0)
    (answer,) = messages(world.run(0.01), "MISSION_COUNT")
    assert answer.count == len(items)
    for i in items:
        world.send("MISSION_REQUEST_INT", target_system=1, target_component=1, seq=i["seq"], mission_type=0)
        (got,) = messages(world.run(0.01), "MISSION_ITEM_INT")
        assert (got.seq, got.command, got.x, got.y, got.z, got.frame) == (
            i["seq"],
            i["command"],
            i["x"],
            i["y"],
            10.0,
            6,
        )
        assert math.isnan(got.param4)
    world.send("MISSION_ACK", target_system=1, target_component=1, type=0, mission_type=0)
    world.run(0.1)


def test_lost_items_are_asked_for_again_every_quarter_second(world):
    items = plan(4)
    started = world.t_s
    assert upload(world, items, lose=lambda seq, attempt: attempt < 3) == R.ACCEPTED
    assert stored(world) == expected(items)
    assert world.t_s - started == pytest.approx(4 * 2 * 0.25, abs=0.5)


def test_an_upload_that_stops_is_given_up_and_the_old_mission_stays(world):
    upload(world, plan(3))
    result = upload(world, plan(6), lose=lambda seq, attempt: seq == 4)
    assert result == R.OPERATION_CANCELLED
    assert stored(world) == expected(plan(3))
    assert upload(world, plan(6)) == R.ACCEPTED


def test_duplicated_and_out_of_order_items_are_ignored(world):
    items = plan(6)
    count(world, 6)
    acks = []
    for order in (0, 0, 1, 3, 0, 2, 2, 5, 3, 4, 4, 5, 5):
        world.send("MISSION_ITEM_INT", **items[order])
        acks += messages(world.run(0.02), "MISSION_ACK")
    assert stored(world) == expected(items)
    # The last item came twice after the end: its acknowledgement is repeated.
    assert {a.type for a in acks} == {R.ACCEPTED}
    assert len(acks) == 2


def test_an_unrequested_item_is_an_error(world):
    world.send("MISSION_ITEM_INT", **item(0))
    (ack,) = messages(world.run(0.01), "MISSION_ACK")
    assert ack.type == R.ERROR
    assert stored(world) == []


def test_the_same_sender_may_start_over(world):
    count(world, 9)
    world.run(0.1)
    assert upload(world, plan(4)) == R.ACCEPTED
    assert stored(world) == expected(plan(4))


def test_plain_items_with_degrees_are_taken_too(world):
    count(world, 1)
    world.run(0.01)
    world.send("MISSION_ITEM", **item(0, x=47.397742, y=8.545594, frame=3))
    (ack,) = messages(world.run(0.01), "MISSION_ACK")
    assert ack.type == R.ACCEPTED
    assert stored(world)[0][2] == pytest.approx(LAT, abs=30)  # float32 degrees


def test_clear(world):
    upload(world, plan())
    world.send("MISSION_CLEAR_ALL", target_system=1, target_component=1, mission_type=255)
    (ack,) = messages(world.run(0.01), "MISSION_ACK")
    assert (ack.type, stored(world)) == (R.ACCEPTED, [])


@pytest.mark.parametrize("kind", [1, 2])
def test_fence_and_rally_exist_and_are_empty(world, kind):
    world.send("MISSION_REQUEST_LIST", target_system=1, target_component=1, mission_type=kind)
    (answer,) = messages(world.run(0.01), "MISSION_COUNT")
    assert (answer.count, answer.mission_type) == (0, kind)
    count(world, 0, kind)
    (ack,) = messages(world.run(0.01), "MISSION_ACK")
    assert (ack.type, ack.mission_type) == (R.ACCEPTED, kind)
    count(world, 3, kind)
    (ack,) = messages(world.run(0.01), "MISSION_ACK")
    assert ack.type == R.NO_SPACE


def test_ten_thousand_items_do_not_fit(world):
    upload(world, plan())
    count(world, 10_000)
    frames = world.run(0.05)
    (ack,) = messages(frames, "MISSION_ACK")
    assert ack.type == R.NO_SPACE
    assert texts(frames) == ["Mission rejected: 10000 items, at most 2000"]
    assert stored(world) == expected(plan())


BAD = [
    (item(1, 31010), R.UNSUPPORTED),
    (item(1, frame=1), R.UNSUPPORTED_FRAME),
    (item(1, frame=10), R.UNSUPPORTED_FRAME),
    (item(1, x=UNKNOWN), R.INVALID_PARAM5_X),
    (item(1, x=0, y=0), R.INVALID_PARAM5_X),
    (item(1, x=950_000_000), R.INVALID_PARAM5_X),
    (item(1, y=1_900_000_000), R.INVALID_PARAM6_Y),
    (item(1, z=math.nan), R.INVALID_PARAM7),
    (item(1, z=math.inf), R.INVALID_PARAM7),
    (item(1, z=10_001.0), R.INVALID_PARAM7),
    (item(1, z=-501.0), R.INVALID_PARAM7),
    (item(1, params=(-1.0, 0.0, 0.0, 0.0)), R.INVALID_PARAM1),
    (item(1, params=(0.0, math.inf, 0.0, 0.0)), R.INVALID_PARAM2),
    (item(1, 177, frame=2, params=(7.0, 1.0, 0.0, 0.0)), R.INVALID_PARAM1),
    (item(1, 177, frame=2, params=(math.nan, 1.0, 0.0, 0.0)), R.INVALID_PARAM1),
    (item(1, 178, frame=2, params=(1.0, math.nan, 0.0, 0.0)), R.INVALID_PARAM2),
]


@pytest.mark.parametrize(("bad", "result"), BAD)
def test_items_that_cannot_be_flown_are_refused_with_the_reason(world, bad, result):
    items = [item(0, 22), bad, item(2)]
    assert upload(world, items) == result
    assert stored(world) == []


@pytest.mark.parametrize("command", [16, 17, 19, 20, 21, 22, 93, 112, 115, 178, 179, 195, 197, 201, 203, 206, 2000])
def test_supported_commands_are_taken(world, command):
    params = (1.0, 2.0, 0.0, 0.0)
    assert upload(world, [item(0, command, params=params)]) == R.ACCEPTED


def test_nan_parameters_take_their_defaults(world):
    nan = math.nan
    items = [item(0, 22, x=UNKNOWN, y=UNKNOWN, params=(nan,) * 4), item(1, params=(nan,) * 4), item(2, 21, x=0, y=0)]
    assert upload(world, items) == R.ACCEPTED


def test_set_current(world):
    upload(world, plan())
    world.send("MISSION_SET_CURRENT", target_system=1, target_component=1, seq=3)
    assert messages(world.run(0.01), "MISSION_CURRENT")[0].seq == 3
    world.send("MISSION_SET_CURRENT", target_system=1, target_component=1, seq=17)
    assert texts(world.run(0.01)) == ["No mission item 17"]


def test_messages_for_others_are_not_answered(world):
    world.send("MISSION_COUNT", target_system=2, target_component=1, count=3, mission_type=0)
    world.send("MISSION_REQUEST_LIST", target_system=1, target_component=191, mission_type=0)
    frames = world.run(0.05)
    assert messages(frames, "MISSION_REQUEST_INT") == messages(frames, "MISSION_COUNT") == []


def test_uploads_of_two_senders_are_kept_apart(world):
    count(world, 3)
    world.run(0.01)
    other = world._bench  # another component of the same computer
    from firmware_bridge.codecs.messages import message_class, pack

    message = message_class("MISSION_COUNT")(target_system=1, target_component=1, count=5, mission_type=0)
    world._outbox.append(other.frame(message.MSGID, pack(message)))
    (ack,) = messages(world.run(0.01), "MISSION_ACK")
    assert (ack.type, ack.target_component) == (R.ERROR, 200)
    for i in plan(3):
        world.send("MISSION_ITEM_INT", **i)
        frames = world.run(0.02)
    assert messages(frames, "MISSION_ACK")[0].type == R.ACCEPTED
