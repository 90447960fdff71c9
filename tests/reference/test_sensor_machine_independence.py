"""The same bits with CPU features masked: every preset with everything on, and every kind of fault."""

from __future__ import annotations

from tests import cpu_masks
from tests.cpu_masks import output_of

FLIGHT = """
import hashlib, struct
import numpy as np
from sim.frame.channels import CHANNELS
from sim.frame.source import SharedFrames
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene
from sim.scene.world import load_world
from sim.sensors.catalog import KINDS, PRESETS, make_sensor
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
    "camera": {"shadows": True, "channels": list(CHANNELS)},
    "lidar": {"beam_divergence_rad": 0.003},
    "radar": {"mount_m": (0.0, 0.0, 1.0), "resolution": (96, 64)},
}
FAULTS = [
    {"kind": "drift", "at_s": 0.4, "until_s": 0.6, "rate_per_s": 0.3},
    {"kind": "stuck_bit", "at_s": 0.6, "until_s": 0.8, "bit": 3, "level": 1},
    {"kind": "freeze", "at_s": 0.8, "until_s": 0.9},
]
scene, tick_ns = load_scene("airfield"), 4_000_000
physics = QuadrotorPhysics(load_vehicle("x500"), scene, tick_ns, initial_yaw_rad=0.4)
frames = SharedFrames(load_world(load_scene("radar_range")))
sensors = []
for name in PRESETS:
    kind = PRESETS[name].kind
    if KINDS[kind].needs_frames:
        extra = FRAME_EXTRA[kind]
        made = make_sensor(
            name, preset=name, rate_hz=2.0, seed=1, scene=scene, step_ns=tick_ns, overrides=extra, frames=frames
        )
        sensors.append((made, 125))
        continue
    every = 25 if kind == "gps" else 1 if kind == "imu" else 5
    made = make_sensor(
        name, preset=name, rate_hz=250.0 / every, seed=1, scene=scene, step_ns=tick_ns, overrides=EXTRA[kind]
    )
    sensors.append((made, every))
    faults = FAULT_LIST.validate_python([f | {"sensor": name} for f in FAULTS])
    again = make_sensor(name, preset=name, rate_hz=250.0 / every, seed=1, scene=scene, step_ns=tick_ns)
    sensors.append((FaultySensor(again, faults), every))
h, digest = physics.vehicle.hover_control, hashlib.sha256()

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
    for sensor, every in sensors:
        if tick % every == 0:
            feed(sensor.sample(truth, tick // every))
assert truth.p_WB[2] > 0.4, truth
print(digest.hexdigest())
"""


def test_masked_cpu_features_change_no_bit_of_any_sensor() -> None:
    assert output_of(FLIGHT) == output_of(FLIGHT, cpu_masks.ALL | {"HIL_ISA": "base"})
