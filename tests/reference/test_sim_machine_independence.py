"""The same bits with CPU features masked: truth and all sensor samples, in the air and on the ground."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from numpy._core import _multiarray_umath as numpy_cpu

ROOT = Path(__file__).resolve().parents[2]

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


def digest(seed: int = 1, **environment: str) -> str:
    result = subprocess.run(
        [sys.executable, "-c", FLIGHT.replace("SEED", str(seed))],
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


def test_masked_cpu_features_change_no_bit() -> None:
    # Only features that numpy can switch and this CPU has may be named.
    switchable = [f for f in numpy_cpu.__cpu_dispatch__ if numpy_cpu.__cpu_features__.get(f)]
    plain = digest()
    masked = digest(
        GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX512VL,-AVX,-FMA4,-SSE4_2,-ERMS",
        NPY_DISABLE_CPU_FEATURES=" ".join(switchable),
    )
    assert plain == masked
    assert plain == digest()
    assert plain != digest(seed=2)
