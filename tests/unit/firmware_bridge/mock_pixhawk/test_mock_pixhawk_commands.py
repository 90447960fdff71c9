"""Commands with acknowledgements, modes, message rates and the small services, by messages."""

import math

import pytest

from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.mock_pixhawk.modes import Mode, mode_from_custom_mode
from firmware_bridge.mock_pixhawk.services.telemetry import DEFAULT_PERIOD_US
from tests.worlds.mock_pixhawk_world import GCS, GCS_COMPONENT, World, messages, results, texts

ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3


def ready_world(**autopilot):
    world = World(**autopilot)
    world.run(5.0)
    return world


def answer(world, command, *params):
    world.command(command, *params)
    return world.run(0.01)


def test_every_command_gets_exactly_one_acknowledgement_to_its_sender(world):
    for command in [*range(16, 30), 80, 176, 178, 179, 185, 192, 224, 300, 400, 410, 511, 512, 519, 520, 2000, 31000]:
        if command == 176:
            continue  # mode 0 of main mode 0: see the test of modes
        world.command(command, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
        acks = messages(world.run(0.01), "COMMAND_ACK")
        assert [a.command for a in acks] == [command]
        assert (acks[0].target_system, acks[0].target_component) == (GCS, GCS_COMPONENT)


def test_unknown_commands_are_unsupported(world):
    for command in (1, 519, 31000, 65535):
        assert results(answer(world, command)) == [(command, UNSUPPORTED)]


def test_infinite_parameters_are_denied(world):
    assert results(answer(world, 22, 0, 0, 0, 0, 0, 0, math.inf)) == [(22, DENIED)]


def test_commands_to_other_systems_are_not_answered(world):
    world.command(512, 148, target_component=100)
    world.send(
        "COMMAND_LONG",
        target_system=7,
        target_component=1,
        command=512,
        confirmation=0,
        **{f"param{i}": 148.0 for i in range(1, 8)},
    )
    assert results(world.run(0.05)) == []
    world.command(512, 148, target_component=0)
    assert results(world.run(0.05)) == [(512, ACCEPTED)]


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.OFFBOARD])
def test_modes_are_set_by_command_and_shown_in_the_heartbeat(world, mode):
    assert results(answer(world, 176, 1, mode.value.main, mode.value.sub)) == [(176, ACCEPTED)]
    heartbeat = messages(world.run(1.1), "HEARTBEAT")[-1]
    assert mode_from_custom_mode(heartbeat.custom_mode) is mode
    assert heartbeat.base_mode & 1


def test_modes_are_set_by_message_too(world):
    world.send("SET_MODE", target_system=1, base_mode=1, custom_mode=Mode.POSCTL.custom_mode)
    assert messages(world.run(1.1), "HEARTBEAT")[-1].custom_mode == 3 << 16


@pytest.mark.parametrize("mode", [(1, 0, 0), (1, 4, 77), (1, 99, 0), (0, 4, 4), (1, math.nan, math.nan)])
def test_modes_that_do_not_exist_are_denied(world, mode):
    assert results(answer(world, 176, *mode)) == [(176, DENIED)]


def test_the_encoding_is_px4s():
    assert Mode.MISSION.custom_mode == 0x04040000
    assert Mode.RTL.custom_mode == 0x05040000
    assert Mode.OFFBOARD.custom_mode == 0x00060000


def test_arm_and_disarm():
    world = ready_world()
    frames = answer(world, 400, 1)
    assert results(frames) == [(400, ACCEPTED)]
    assert world.autopilot.vehicle.armed
    assert max(world.controls) > 0.0
    assert all(abs(u - round(u, 3)) < 1e-7 for u in world.controls)  # steps of 1/1000, as float32
    assert results(answer(world, 400, 0)) == [(400, ACCEPTED)]
    assert world.controls == (0.0,) * 16
    assert results(answer(world, 400, 0.5)) == [(400, DENIED)]


def test_armed_on_the_ground_it_disarms_after_ten_seconds():
    world = ready_world()
    answer(world, 400, 1)
    frames = world.run(10.1)
    assert "Disarmed by auto preflight disarming" in texts(frames)
    assert not world.autopilot.vehicle.armed


@pytest.mark.parametrize(("mode", "reason"), [(Mode.RTL, "Return"), (Mode.LAND, "Land")])
def test_modes_that_cannot_take_off_do_not_arm(mode, reason):
    world = ready_world()
    answer(world, 176, 1, mode.value.main, mode.value.sub)
    frames = answer(world, 400, 1)
    assert results(frames) == [(400, REJECTED)]
    assert any(reason in text for text in texts(frames))


def test_mission_mode_without_a_mission_does_not_arm():
    world = ready_world()
    answer(world, 176, 1, 4, 4)
    frames = answer(world, 400, 1)
    assert results(frames) == [(400, REJECTED)]
    assert "Preflight Fail: no valid mission" in texts(frames)
    assert results(answer(world, 300)) == [(300, DENIED)]


def test_manual_modes_need_sticks():
    world = ready_world()
    answer(world, 176, 1, 3)
    assert results(answer(world, 400, 1)) == [(400, REJECTED)]
    world.send("MANUAL_CONTROL", target=1, x=0, y=0, z=0, r=0, buttons=0)
    assert results(answer(world, 400, 1)) == [(400, ACCEPTED)]


def test_message_rates_are_the_requested_ones(world):
    for name in ("ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW"):
        assert results(answer(world, 511, MSGID[name], 20_000)) == [(511, ACCEPTED)]
    world.run(6.0)
    frames = world.run(4.0)
    for name in ("ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW"):
        assert len(messages(frames, name)) == 200
    answer(world, 511, MSGID["ATTITUDE_QUATERNION"], -1)
    answer(world, 511, MSGID["SERVO_OUTPUT_RAW"], 0)
    frames = world.run(2.0)
    assert messages(frames, "ATTITUDE_QUATERNION") == []
    assert len(messages(frames, "SERVO_OUTPUT_RAW")) == 2
    assert results(answer(world, 511, 12345, 1000)) == [(511, UNSUPPORTED)]


def test_default_rates():
    frames = ready_world().run(4.0)
    for name, period_us in DEFAULT_PERIOD_US.items():
        expected = 4_000_000 // period_us if period_us else 0
        assert abs(len(messages(frames, name)) - expected) <= 1, name
    # All of it is recorded and hashed in every run.
    assert sum(len(frame.raw) for frame in frames) / 4.0 < 4000


@pytest.mark.parametrize("name", sorted(DEFAULT_PERIOD_US))
def test_any_message_can_be_asked_for_once(name):
    world = ready_world()
    frames = answer(world, 512, MSGID[name])
    assert results(frames) == [(512, ACCEPTED)]
    assert messages(frames, name)


def test_telemetry_agrees_with_the_truth():
    frames = ready_world().run(2.0)
    fix, place = messages(frames, "GPS_RAW_INT")[-1], messages(frames, "GLOBAL_POSITION_INT")[-1]
    assert abs(place.lat - 473_977_420) < 20
    assert abs(place.lon - 85_455_940) < 20
    assert abs(place.alt - 488_229) < 300
    assert abs(fix.lat - place.lat) < 20
    attitude = messages(frames, "ATTITUDE")[-1]
    assert abs(attitude.roll) < 0.02
    assert abs(attitude.pitch) < 0.02
    assert abs(attitude.yaw - math.pi / 2) < 0.1  # faces east
    status = messages(frames, "SYS_STATUS")[-1]
    assert status.onboard_control_sensors_health & 0x2F == 0x2F
    assert messages(frames, "EXTENDED_SYS_STATE")[-1].landed_state == 1
    home = messages(frames, "HOME_POSITION")[-1]
    assert abs(home.latitude - 473_977_420) < 20


def test_version(world):
    frames = answer(world, 520, 1)
    assert results(frames) == [(520, ACCEPTED)]
    (version,) = messages(frames, "AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 24 == 1
    assert version.capabilities & 0x2000  # MAVLink 2
    assert not version.capabilities & 0x20  # no FTP


def test_timesync_and_ping(world):
    world.send("TIMESYNC", tc1=0, ts1=123456789)
    (reply,) = messages(world.run(0.004), "TIMESYNC")
    assert reply.ts1 == 123456789
    assert reply.tc1 == world.autopilot.vehicle.now_us * 1000 - 4_000_000
    world.send("TIMESYNC", tc1=55, ts1=44)  # an answer to another request
    world.send("PING", time_usec=7, seq=8, target_system=0, target_component=0)
    frames = world.run(0.05)
    assert messages(frames, "TIMESYNC") == []
    (ping,) = messages(frames, "PING")
    assert (ping.time_usec, ping.seq, ping.target_system, ping.target_component) == (7, 8, GCS, GCS_COMPONENT)


@pytest.mark.parametrize(("opcode", "reply", "code"), [(4, 129, 10), (3, 129, 10), (2, 128, 0), (77, 129, 7)])
def test_file_transfer_is_refused_cleanly(world, opcode, reply, code):
    request = bytearray(251)
    request[0:4] = bytes((41, 0, 9, opcode))
    world.send("FILE_TRANSFER_PROTOCOL", target_network=0, target_system=1, target_component=1, payload=tuple(request))
    (got,) = messages(world.run(0.01), "FILE_TRANSFER_PROTOCOL")
    assert got.payload[0:6] == (42, 0, 9, reply, 1 if code else 0, opcode)
    assert got.payload[12] == code


def test_home_can_be_asked_for_and_set():
    world = ready_world()
    assert results(answer(world, 410)) == [(410, ACCEPTED)]
    assert results(answer(world, 179, 0, 0, 0, 0, 47.4, 8.55, 500.0)) == [(179, ACCEPTED)]
    (home,) = messages(answer(world, 512, MSGID["HOME_POSITION"]), "HOME_POSITION")
    # COMMAND_LONG carries degrees as float32.
    assert home.latitude == pytest.approx(474_000_000, abs=30)
    assert home.longitude == pytest.approx(85_500_000, abs=10)
    assert home.altitude == 500_000


def test_commands_with_integer_places():
    world = ready_world()
    fields = {f"param{i}": 0.0 for i in range(1, 5)}
    world.send(
        "COMMAND_INT",
        target_system=1,
        target_component=1,
        frame=0,
        command=179,
        current=0,
        autocontinue=0,
        x=474_000_000,
        y=85_500_000,
        z=500.0,
        **fields,
    )
    assert results(world.run(0.01)) == [(179, ACCEPTED)]
    assert world.autopilot.vehicle.home.lat_deg == pytest.approx(47.4)
