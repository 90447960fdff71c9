"""The parameter protocol with PX4's bytewise encoding."""

import struct

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk.parameters.params import TYPE_INT32, TYPE_REAL32
from tests.worlds.mock_pixhawk_world import texts

VALUE = struct.Struct("<4sHH16sB")


def values(frames):
    found = []
    for frame in frames:
        if frame.msgid == MSGID["PARAM_VALUE"]:
            bits, count, index, name, kind = VALUE.unpack(frame.payload)
            value = struct.unpack("<i" if kind == TYPE_INT32 else "<f", bits)[0]
            found.append((name.rstrip(b"\0").decode(), value, kind, index, count))
    return found


def put(world, name, value, kind, *, system=1):
    bits = struct.pack("<i", value) if kind == TYPE_INT32 else struct.pack("<f", value)
    payload = struct.pack("<4sBB16sB", bits, system, 1, name.encode(), kind)
    world._outbox.append(FrameEncoder(255, 190).frame(MSGID["PARAM_SET"], payload))


def test_the_list_has_every_parameter_once_in_order_paced_in_simulated_time(world):
    world.send("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    found = values(world.run(3.0))
    names = [name for name, *_ in found]
    assert names == sorted(names) == world.autopilot.params.names()
    assert [index for *_, index, _ in found] == list(range(len(names)))
    assert {count for *_, count in found} == {len(names)}
    assert len(names) > 100
    # Never more than one per 8 ms.
    world.send("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    assert len(values(world.run(0.4))) <= 50


def test_read_by_name_and_by_index_and_unknown(world):
    world.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_id="SYS_AUTOSTART", param_index=-1)
    ((name, value, kind, index, _),) = values(world.run(0.01))
    assert (name, value, kind) == ("SYS_AUTOSTART", 4001, TYPE_INT32)
    world.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_id="", param_index=index)
    assert values(world.run(0.01))[0][0] == "SYS_AUTOSTART"
    world.send("PARAM_REQUEST_READ", target_system=1, target_component=1, param_id="NO_SUCH", param_index=-1)
    assert "unknown param: NO_SUCH" in texts(world.run(0.01))


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [("NAV_DLL_ACT", 2, TYPE_INT32), ("CBRK_FLIGHTTERM", 0, TYPE_INT32), ("MPC_XY_CRUISE", 7.5, TYPE_REAL32)],
)
def test_set_answers_with_the_new_value(world, name, value, kind):
    put(world, name, value, kind)
    assert values(world.run(0.01))[0][:3] == (name, value, kind)
    assert world.autopilot.params[name] == value


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("MPC_XY_CRUISE", 500.0, TYPE_REAL32),  # out of range
        ("MPC_XY_CRUISE", float("nan"), TYPE_REAL32),
        ("MPC_XY_CRUISE", 5, TYPE_INT32),  # wrong type
        ("CA_ROTOR_COUNT", 99, TYPE_INT32),  # the flight core's own limit
    ],
)
def test_a_refused_value_is_answered_with_the_old_one_and_a_reason(world, name, value, kind):
    before = world.autopilot.params[name]
    put(world, name, value, kind)
    frames = world.run(0.01)
    assert values(frames)[0][1] == before
    assert any(name in text for text in texts(frames))


def test_integers_keep_every_bit(world):
    # As a float these bits would be a signalling NaN.
    put(world, "COM_FLTMODE1", 0x7F800001, TYPE_INT32)
    assert values(world.run(0.01))[0][1] == 0x7F800001


def test_parameters_of_the_flight_core_reach_it(world):
    put(world, "MPC_XY_P", 0.75, TYPE_REAL32)
    world.run(0.01)
    core = world.autopilot.firmware.core
    assert core.get_param(world.autopilot.firmware.native_index["MPC_XY_P"]) == 0.75


def test_requests_to_others_are_not_answered(world):
    put(world, "MPC_XY_CRUISE", 7.5, TYPE_REAL32, system=2)
    world.send("PARAM_REQUEST_LIST", target_system=1, target_component=154)
    assert values(world.run(0.5)) == []
