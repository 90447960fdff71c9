"""Check of the starts of several vehicles: none may begin inside another."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import mujoco
import numpy as np

from sim.physics.contact_model import build_model
from sim.physics.flight_start import FlightStart
from sim.physics.joint_contact import reach_m
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene

_CONTACT_STEP_S = 0.001


def overlapping_starts(scene: Scene, vehicles: Mapping[str, tuple[Vehicle, FlightStart]]) -> list[tuple[str, str]]:
    """Return the pairs of names whose vehicles touch or overlap at their starts, in the mapping's order."""
    models: list[tuple[tuple[Vehicle, Vehicle], mujoco.MjModel]] = []
    found = []
    for (a, (first, start)), (b, (second, other)) in combinations(vehicles.items(), 2):
        poses = [_pose(first, start), _pose(second, other)]
        if float(np.linalg.norm(poses[1][:3] - poses[0][:3])) >= reach_m(first) + reach_m(second):
            continue
        model = next((model for types, model in models if types == (first, second)), None)
        if model is None:
            model = build_model(scene, first, second, contact_step_s=_CONTACT_STEP_S)
            models.append(((first, second), model))
        data = mujoco.MjData(model)
        data.qpos[:] = np.concatenate(poses)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if any(set(pair) == {1, 2} for pair in model.geom_bodyid[data.contact.geom].tolist()):
            found.append((a, b))
    return found


def _pose(vehicle: Vehicle, start: FlightStart) -> np.ndarray:
    x, y, z = start.ground_W
    p_WB = (x, y, z + vehicle.standing_height_m) if start.p_WB is None else start.p_WB
    return np.array([*p_WB, *vehicle.standing_quat(start.yaw_rad)])
