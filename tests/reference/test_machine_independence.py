"""Physics, autopilot and sensors give the same bits with CPU features masked."""

from __future__ import annotations

import pytest

from tests.worlds import cpu_masks
from tests.worlds.cpu_masks import output_of

# Gusts, turbulence, battery, faults, hard landings.
FLIGHT = """
import hashlib
from sim.physics import multirotor
from sim.physics.forces.force import Effects
from sim.physics.disturbances import Disturbances
from sim.physics.faults import RotorFault
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle_physics import VehiclePhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Turbulence, Wind

wind = Wind(steady_W_mps=(3.0, 1.0, 0.0), turbulence=Turbulence(level="moderate"),
            gusts=(GustEvent(at_s=0.5, velocity_W_mps=(5.0, -3.0, 0.5), rise_s=0.3),))
faults = [RotorFault(kind="lost_blade", rotor=1, at_s=1.0, imbalance_gcm=12.0),
          RotorFault(kind="stuck", rotor=2, at_s=1.2, speed_radps=100.0)]
digest = hashlib.sha256()
for name in ("x500", "racer"):
    physics = VehiclePhysics(load_vehicle(name), load_scene("airfield"), 4_000_000, effects=Effects(battery=True),
                               disturbances=Disturbances(wind, 3, faults), start=FlightStart(yaw_rad=0.4))
    h = multirotor.hover_control(physics.vehicle)
    for tick in range(800):
        truth = physics.advance(tick, (1.15 * h,) * 4 if tick < 400 else (0.0,) * 4)
        digest.update(repr((truth, physics.wind_W_mps, physics.battery)).encode())
    assert physics.skips.skipped > 50 and physics.skips.touching > 5, physics.skips
print(digest.hexdigest())
"""

# Vehicles of different types that meet in the air, fall on each other, and blow at each other.
GROUP = """
import hashlib
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle_physics import VehiclePhysics
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_group import VehicleGroup
from sim.scene.scene import load_scene

vehicles = {}
for index, name in enumerate(("x500", "racer", "hexa_x", "y6")):
    x_m, y_m = 1.2 * (index % 2), 1.2 * (index // 2)
    start = FlightStart(p_WB=(x_m, y_m, 1.5 + 0.1 * index), yaw_rad=0.3 * index)
    vehicles[name] = physics = VehiclePhysics(load_vehicle(name), load_scene("airfield"), 4_000_000, start=start)
    physics.state[7:13] = (2.0 * (0.6 - x_m), 2.0 * (0.6 - y_m), 0.0, 1.0, -2.0, 0.5)
group, digest = VehicleGroup(vehicles, downwash=True), hashlib.sha256()
controls = [(0.6 * multirotor.hover_control(v.vehicle),) * len(v.vehicle.rotors) for v in vehicles.values()]
for tick in range(300):
    digest.update(repr(group.advance(tick, controls)).encode())
contacts = group.take_contacts(last=True)
digest.update(repr(contacts).encode())
assert len(contacts) > 3, contacts
print(digest.hexdigest())
"""

# Ideal controller and AirSim's moves.
MOVES = """
import hashlib
from hil.apps.airsim.flight.path import PathOptions, TakeOff, move_on_path
from hil.apps.airsim.flight.spot import Land, RotateToYaw
from hil.apps.airsim.flight.timed import move_by_attitude, move_by_velocity
from hil.apps.airsim.flight.yaw import YawMode
from sim.physics.disturbances import Disturbances
from sim.physics.vehicle_physics import VehiclePhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.wind import Turbulence, Wind
from tests.worlds.airsim_flight import AIRFIELD, TICK_NS, Pilot

wind = Wind(steady_W_mps=(3.0, 1.0, 0.0), turbulence=Turbulence(level="moderate"))
digest = hashlib.sha256()
for name in ("iris", "y6"):
    physics = VehiclePhysics(load_vehicle(name), AIRFIELD, TICK_NS, disturbances=Disturbances(wind=wind, seed=3))
    pilot = Pilot(physics)
    for move in (
        TakeOff(20.0),
        move_on_path([(3.0, 0.0, -4.0), (3.0, 4.0, -4.0)], PathOptions(3.0, 3e38, 1, YawMode(False, 10.0))),
        RotateToYaw(20.0, 10.0, 5.0),
        move_by_velocity((2.0, 1.0, 1.0), 1.0, 1, YawMode(False, 45.0), body=True),
        move_by_attitude(1.5, roll=0.1, pitch=0.05, yaw=0.3, z=-1.0),
        Land(20.0),
    ):
        digest.update(repr(pilot.do(move)).encode())
    digest.update(repr(pilot.log).encode())
print(digest.hexdigest())
"""

# LiDAR, detections and sweeps of objects of AirSim's server.
SERVER = """
import hashlib, json
from hil.apps.airsim.api.catalog import method_table
from hil.apps.airsim.command import Choice, make_simulation
from hil.apps.airsim.rpc.methods import Pending
from hil.apps.airsim.rpc.packing import pack
from hil.apps.airsim.settings.settings import read_settings

LIDAR = {"SensorType": 6, "Enabled": True, "NumberOfChannels": 8, "PointsPerSecond": 8000, "HorizontalFOVStart": -45,
         "HorizontalFOVEnd": 45, "VerticalFOVUpper": 5, "VerticalFOVLower": -20}
VEHICLE = {"VehicleType": "SimpleFlight", "Yaw": 20, "Sensors": {"Scan": LIDAR}}
settings = {"SettingsVersion": 1.2, "SimMode": "Multirotor", "Vehicles": {"A": VEHICLE}}
simulation = make_simulation(Choice(scene="blocks"), read_settings(json.dumps(settings), "settings.json"), print)
table, digest = method_table(simulation), hashlib.sha256()

def call(name, *arguments):
    result = table.call(name, list(arguments))
    if isinstance(result, Pending):  # of a thread, where there is an event loop
        assert result.done
        result = result.result
    digest.update(pack(result))
    return result

for tick in range(50):
    simulation.step()
pose = call("simGetObjectPose", "OrangeBall")
there = {"position": {"x_val": 9.3, "y_val": 1.7, "z_val": -2.9},
         "orientation": {"w_val": 0.9, "x_val": 0.1, "y_val": 0.3, "z_val": 0.3}}
assert call("simSetObjectPose", "OrangeBall", there, False)
assert call("simGetObjectPose", "OrangeBall") != pose
simulation.step()
call("simAddDetectionFilterMeshName", "0", 0, "*", "A")
assert len(call("simGetDetections", "0", 0, "A")) > 1
assert len(call("getLidarData", "Scan", "A")["point_cloud"]) > 30
print(digest.hexdigest())
"""

# Presets with everything on, and every kind of fault.
SENSORS = """
LEFT_OUT = {"bgt60tr13c_wideband", "hdl32e", "os1_64", "ov9281"}  # their kinds have other presets
import hashlib, struct
import numpy as np
from signals.channels import CHANNELS
from sim.frame.source import SharedFrames
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle_physics import VehiclePhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from sim.sensors.catalog import KINDS, PRESETS, make_sensor
from sim.sensors.sensor import Installation
from sim.sensors.faults import FAULT_LIST, FaultySensor

EXTRA = {
    "imu": {
        "lever_arm_m": (0.05, -0.02, 0.01), "warm_up_degc": 10.0, "warm_up_time_constant_s": 3.0,
        "vibration": [{"order": 1.0, "accel_mps2": (1.0, 1.0, 0.3), "gyro_radps": (0.01, 0.01, 0.0)},
                      {"order": 2.0, "accel_mps2": (0.2, 0.2, 1.5)}],
    },
    "barometer": {"wash_free_pa": -4.0, "wash_ground_pa": 12.0, "flow_coefficient": (0.1, -0.05)},
    "magnetometer": {"motor_field_tesla": (1e-6, 2e-6, -1e-6)},
    "gps": {"antenna_m": (0.1, 0.0, 0.05), "loss": [{"from_s": 0.6, "until_s": 0.9}]},
    "range_finder": {"mount_m": (0.0, 0.05, -0.05), "dropout_probability": 0.05},
    "optical_flow": {"mount_m": (0.0, 0.05, -0.05)},
}
FRAME_EXTRA = {
    "camera": {"shadows": True, "channels": list(CHANNELS), "resolution": (160, 120)},
    "lidar": {"beam_divergence_rad": 0.003},
    "radar": {"mount_m": (0.0, 0.0, 1.0), "resolution": (96, 64)},
    "spinning_radar": {"mount_m": (0.0, 0.0, 1.0), "bins": 700, "threshold_db": 6.0},
}
FAULTS = [
    {"kind": "drift", "at_s": 0.4, "until_s": 0.6, "rate_per_s": 0.3},
    {"kind": "stuck_bit", "at_s": 0.6, "until_s": 0.8, "bit": 3, "level": 1},
    {"kind": "freeze", "at_s": 0.8, "until_s": 0.9},
]
scene, tick_ns = load_scene("airfield"), 4_000_000
physics = VehiclePhysics(load_vehicle("x500"), scene, tick_ns, start=FlightStart(yaw_rad=0.4))
frames = SharedFrames(load_world(load_scene("radar_range")))
sensors = []
for name in sorted(PRESETS.keys() - LEFT_OUT):
    kind = PRESETS[name].kind
    if KINDS[kind].needs_frames:
        extra = FRAME_EXTRA[kind]
        made = make_sensor(
            Installation(name, rate_hz=1.0, seed=1, scene=scene, step_ns=tick_ns, frames=frames),
            preset=name, overrides=extra,
        )
        sensors.append((made, 250, 250))  # above the ground
        continue
    every = 25 if kind == "gps" else 1 if kind == "imu" else 5
    installation = Installation(
        name, rate_hz=250.0 / every, seed=1, scene=scene, step_ns=tick_ns, shaken_by=physics.vehicle
    )
    made = make_sensor(installation, preset=name, overrides=EXTRA.get(kind, {}))
    sensors.append((made, every, 0))
    faults = FAULT_LIST.validate_python([f | {"sensor": name} for f in FAULTS])
    again = make_sensor(installation, preset=name)
    sensors.append((FaultySensor(again, faults), every, 0))
h, digest = multirotor.hover_control(physics.vehicle), hashlib.sha256()

def feed(value):
    if isinstance(value, np.ndarray):
        digest.update(value.tobytes())
    elif isinstance(value, dict):
        feed(tuple(value.values()))
    elif isinstance(value, tuple):
        for item in value:
            feed(item)
    else:
        digest.update(struct.pack("<d", float(value)))

for tick in range(300):
    wobble = 0.004 * ((tick % 13) - 6)
    level = 0.0 if tick < 20 else 1.06 * h if tick < 250 else 0.95 * h
    controls = (level, level - wobble, level + wobble, level) if level else (0.0,) * 4
    truth = physics.advance(tick, controls)
    for sensor, every, first in sensors:
        if tick % every == 0 and tick >= first:
            feed(sensor.sample(truth, tick // every))
assert truth.p_WB[2] > 0.4, truth
print(digest.hexdigest())
"""

# Receivers that see the sky past houses, with reflections, a jammer and a spoofer.
SKY = """
import hashlib
from sim.sensors.faults import FAULT_LIST, FaultySensor
from tests.worlds.street_canyon import at, canyon, receiver_in

FAULTS = FAULT_LIST.validate_python([
    {"kind": "jammer", "sensor": "gps", "at_s": 4.0, "until_s": 5.0, "place_m": (30.0, 5.0, 2.0), "power_dbm": 5.0},
    {"kind": "spoofer", "sensor": "gps", "at_s": 7.0, "until_s": 8.0, "place_m": (0.0, 90.0, 9.0), "power_dbm": 0.0,
     "offset_m": (5.0, 0.0, 0.0)},
])
digest = hashlib.sha256()
for preset in ("m8n", "f9p"):
    gps = receiver_in(canyon(), preset=preset, antenna_m=(0.1, 0.0, 0.05))
    faulty, reflected = FaultySensor(gps, FAULTS), 0
    for k in range(50):
        q_WB = (0.9689124217106447, 0.0, 0.24740395925452294, 0.0)
        truth = at((0.3, -30.0 + 1.1 * k, 1.5 + 0.6 * k), 0.2 * k, v_WB_W=(0.0, 5.5, 3.0), q_WB=q_WB)
        digest.update(repr((faulty.sample(truth, k), gps.sky_fix, gps.receiver.views)).encode())
        reflected += gps.sky_fix.reflected
    assert reflected > 0 or preset == "f9p"
print(digest.hexdigest())
"""

# Frames of few and many echoes by every method, in single and double precision, and their processing.
ECHOES = """
import hashlib, itertools
import numpy as np
from signals.noise import NoiseStream
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processor
from sim.physics import multirotor
from sim.radar.synthesis import Synthesizer

RX = ((0.0, 0.0025, 0.0), (0.0, 0.0, 0.0025), (0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.02, 0.0))
SETTINGS = dict(center_frequency_hz=60.8e9, bandwidth_hz=0.4e9, sample_rate_hz=2e6)
CHIRPS = (
    Chirp(**SETTINGS, samples=64, chirps=64, repetition_s=390.975e-6),
    Chirp(**SETTINGS, samples=50, chirps=27, repetition_s=500e-6),
)

CROWD = 9001

def echoes_of(count):
    stream = NoiseStream(1, "echoes")
    u = np.concatenate([stream.uniform_block(b)[:, 0] for b in range(6 * count // 256 + 1)])
    u = u[: 6 * count].reshape(6, count)
    direction = np.ascontiguousarray(u[:3].T * 1.1 - 0.55)
    amplitude = u[5] * u[5] * u[5] * u[5]
    amplitude[: count // 2] *= 1e-12
    range_m, speed_mps = u[3] * 40.0, u[4] * 16.0 - 8.0
    if count == CROWD:  # most in one cell: grids in single precision are emptied into doubles on the way
        range_m[200:], direction[200:] = 4.2, (1.0, 0.0, 0.0)
        speed_mps[200:] = 0.7 + 6.3053 * (np.arange(count - 200) % 3 - 1)
    return Echoes(range_m, speed_mps, direction, amplitude)

digest = hashlib.sha256()
for chirp, receivers in ((CHIRPS[0], 3), (CHIRPS[1], 5)):
    for method, tolerance, count in (
        ("direct", 1e-3, 203), ("nufft", 1e-1, 3001), ("nufft", 1e-3, 3001), ("nufft", 1e-9, 3001),
        ("nufft", 1e-3, 5), ("nufft", 1e-3, CROWD),
    ):
        synthesizer = Synthesizer(
            chirp, RX[:receivers], hp_cutoff_hz=80e3, aaf_cutoff_hz=600e3, method=method, tolerance=tolerance
        )
        out = np.empty(synthesizer.shape)
        report = synthesizer.synthesize(echoes_of(count), out)
        digest.update(out.tobytes())
        digest.update(repr([getattr(report, name) for name in dir(report) if name[0] != "_"]).encode())
        raw = np.clip(2048.0 + 900.0 * out / np.abs(out).max(), 0, 4095).astype(np.uint16)
        processed = Processor(chirp, RX[:receivers], Processing(clutter="none")).process(raw, 0)
        for array in (processed.range_doppler, processed.points):
            digest.update(array.tobytes())
print(digest.hexdigest())
"""


# Each number of receivers with each chirp, in place of one each.
EVERY_ECHO = ECHOES.replace("((CHIRPS[0], 3), (CHIRPS[1], 5))", "itertools.product(CHIRPS, (3, 5))")
EVERY_SENSOR = SENSORS.replace("- LEFT_OUT", "")


GROUPS = [
    {"flight": FLIGHT, "group": GROUP, "moves": MOVES, "server": SERVER},
    {"sensors": SENSORS, "echoes": ECHOES, "sky": SKY},
    pytest.param({"every sensor": EVERY_SENSOR, "every echo": EVERY_ECHO}, marks=pytest.mark.slow),
]


def digests(scripts: dict[str, str], environment: dict[str, str]) -> dict[str, str]:
    """Return each script's digest. They run in one process, because loading the bench takes as long as most of them."""
    lines = "for name, script in SCRIPTS.items():\n    print(name, end=': ')\n    exec(script, {'__name__': name})\n"
    output = output_of(lines.replace("SCRIPTS", repr(scripts)), environment)
    return dict(line.split(": ") for line in output.splitlines())


@pytest.mark.parametrize("scripts", GROUPS, ids=", ".join)
def test_masked_cpu_features_change_no_bit(scripts: dict[str, str]) -> None:
    plain = digests(scripts, {})
    assert set(plain) == set(scripts)
    assert plain == digests(scripts, cpu_masks.ALL | {"HIL_ISA": "base"})
    echoes = {name: script for name, script in scripts.items() if script in (ECHOES, EVERY_ECHO)}
    if echoes:
        assert plain | digests(echoes, {"HIL_ISA": "avx2"}) == plain
