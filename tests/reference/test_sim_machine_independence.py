"""The same bits with CPU features masked: truth and all sensor samples, in the air and on the ground."""

from __future__ import annotations

from tests import cpu_masks
from tests.cpu_masks import output_of

FLIGHT = """
import hashlib, struct
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene
from sim.sensors.catalog import make_sensor

scene, tick_ns = load_scene("airfield"), 4_000_000
physics = QuadrotorPhysics(load_vehicle("x500"), scene, tick_ns, initial_yaw_rad=0.4)
sensors = [
    (make_sensor(name, preset=preset, rate_hz=rate, seed=SEED, scene=scene, step_ns=tick_ns), 250 // rate)
    for name, preset, rate in (("imu", "icm20689", 250), ("baro", "ms5611", 50), ("mag", "ist8310", 125),
                               ("gps", "here_plus", 10), ("gps2", "m8n", 5))
]
h, digest = physics.vehicle.hover_control, hashlib.sha256()

def feed(value):
    if isinstance(value, tuple):
        for item in value:
            feed(item)
    else:
        digest.update(struct.pack("<d", float(value)))

for tick in range(700):
    wobble = 0.004 * ((tick % 13) - 6)
    level = 0.0 if tick < 50 or tick > 450 else 1.04 * h if tick < 250 else 0.95 * h
    controls = (level, level - wobble, level + wobble, level) if level else (0.0,) * 4
    truth = physics.advance(tick, controls)
    feed(truth)
    for sensor, every in sensors:
        if tick % every == 0:
            feed(sensor.sample(truth, tick // every))
assert physics.skips.touching > 100 and truth.in_contact and physics.skips.skipped > 100, physics.skips
print(digest.hexdigest())
"""


def digest(seed: int = 1, environment: dict[str, str] | None = None) -> str:
    return output_of(FLIGHT.replace("SEED", str(seed)), environment)


def test_masked_cpu_features_change_no_bit() -> None:
    plain = digest()
    assert plain == digest(environment=cpu_masks.ALL)
    assert plain == digest()
    assert plain != digest(seed=2)
