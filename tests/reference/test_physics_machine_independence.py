"""The same bits with CPU features masked: gusts, turbulence, battery, faults, hard landings."""

from __future__ import annotations

from tests import cpu_masks
from tests.cpu_masks import output_of

FLIGHT = """
import hashlib
from sim.physics.vehicle import Effects
from sim.physics.faults import RotorFault
from sim.physics.quadrotor import QuadrotorPhysics
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Turbulence, Wind

wind = Wind(steady_W_mps=(3.0, 1.0, 0.0), turbulence=Turbulence(level="moderate"),
            gusts=(GustEvent(at_s=0.5, velocity_W_mps=(5.0, -3.0, 0.5), rise_s=0.3),))
faults = [RotorFault(kind="lost_blade", rotor=1, at_s=1.0, imbalance_gcm=15.0),
          RotorFault(kind="stuck", rotor=2, at_s=1.2, speed_radps=100.0)]
digest = hashlib.sha256()
for name in ("x500", "racer"):
    physics = QuadrotorPhysics(load_vehicle(name), load_scene("airfield"), 4_000_000, effects=Effects(battery=True),
                               faults=faults, wind=wind, seed=3, initial_yaw_rad=0.4)
    h = physics.vehicle.hover_control
    for tick in range(800):
        truth = physics.advance(tick, (1.15 * h,) * 4 if tick < 400 else (0.0,) * 4)
        digest.update(repr((truth, physics.wind_W_mps, physics.battery)).encode())
    assert physics.skips.skipped > 50 and physics.skips.touching > 5, physics.skips
print(digest.hexdigest())
"""


def test_masked_cpu_features_change_no_bit() -> None:
    assert output_of(FLIGHT) == output_of(FLIGHT, cpu_masks.ALL)
