"""Launch of a plane: held on a rail, then pulled along it by a catapult, a bungee or a hand.

In a bench file, below `start`:

    start: {p_W: [0, 0, 0], yaw_deg: 0, launch: {kind: catapult, length_m: 3, speed_mps: 14, elevation_deg: 10}}

    held      until `at_s`, or until the mean command of the rotors has been at least `throttle`, and `delay_s` later.
              The pose stays; rotors and surfaces move
    pulled    along the rail, with its attitude kept, by the force of sim/native/forces/launcher.cpp and all others:
              m s'' = F_0 - k s + (thrust, air, weight) . d
                catapult   F_0 = m speed^2 / (2 length), k = 0
                hand       the same over the way of an arm
                bungee     F_0 = k stretch; it ends where it is slack or at the end of the rail
    released  at the end of the pull, free

The rail is frictionless. It is applied at the ends of ticks: what lies across the rail is removed there, so forces that
turn or lift the vehicle within a tick act on it for no longer than that. `speed_mps` is reached where the pull alone
acts; thrust adds to it and weight takes from it.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals._kernel import det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.rotation import product
from signals.samples import Quat, Vec3
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim import _kernels

_Speed = Annotated[float, Field(gt=0.5, le=60.0)]
_P, _Q, _V, _W = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)


class _Launch(StrictModel):
    """Common keys of all launches."""

    elevation_deg: Annotated[float, Field(ge=-30.0, le=80.0)] = 10.0  # of the rail, and of the vehicle on it
    height_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.2  # of the body origin over `start.p_W`
    throttle: Annotated[float, Field(ge=0.01, le=1.0)] = 0.5  # mean command of the rotors that releases it
    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)] | None = None  # releases it at this time instead
    delay_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.5

    def pull(self, mass_kg: float) -> tuple[float, float, float]:
        """Return force at the start [N], its loss along the way [N/m], and length [m]."""
        raise NotImplementedError


class Catapult(_Launch):
    """Constant force over a length."""

    kind: Literal["catapult"]
    length_m: Annotated[float, Field(gt=0.05, le=50.0)]
    speed_mps: _Speed

    def pull(self, mass_kg: float) -> tuple[float, float, float]:
        return mass_kg * self.speed_mps**2 / (2.0 * self.length_m), 0.0, self.length_m


class Hand(_Launch):
    """Throw."""

    kind: Literal["hand"]
    speed_mps: _Speed
    length_m: Annotated[float, Field(gt=0.05, le=3.0)] = 1.0  # way of the arm

    def pull(self, mass_kg: float) -> tuple[float, float, float]:
        return mass_kg * self.speed_mps**2 / (2.0 * self.length_m), 0.0, self.length_m


class Bungee(_Launch):
    """Elastic line, stretched."""

    kind: Literal["bungee"]
    stiffness_npm: Annotated[float, Field(gt=0.0, le=1e5)]
    stretch_m: Annotated[float, Field(gt=0.05, le=100.0)]

    def pull(self, mass_kg: float) -> tuple[float, float, float]:
        del mass_kg
        return self.stiffness_npm * self.stretch_m, self.stiffness_npm, self.stretch_m


Launch = Annotated[Catapult | Hand | Bungee, Field(discriminator="kind")]


class LaunchRail:
    """Holds a vehicle, pulls it along its rail and lets it go. Works on the state of the body."""

    def __init__(
        self,
        launch: Catapult | Hand | Bungee,
        force: _kernels.Launcher,
        *,
        ground_W: Vec3,
        yaw_rad: float,
        mass_kg: float,
        rotors: int,
        tick_ns: int,
    ) -> None:
        self._launch, self._force, self._mass_kg, self._rotors, self._tick_ns = launch, force, mass_kg, rotors, tick_ns
        up = launch.elevation_deg * RAD_PER_DEG
        c, s = det_cos(up), det_sin(up)
        self._along: Vec3 = (c * det_cos(yaw_rad), c * det_sin(yaw_rad), s)
        yaw: Quat = (det_cos(0.5 * yaw_rad), 0.0, 0.0, det_sin(0.5 * yaw_rad))
        self.q_WB: Quat = product(yaw, (det_cos(0.5 * up), 0.0, -det_sin(0.5 * up), 0.0))
        x, y, z = ground_W
        self.p_WB: Vec3 = (x, y, z + launch.height_m)
        self._length_m = launch.pull(mass_kg)[2]
        self.reset()

    def reset(self) -> None:
        """Hold the vehicle again."""
        self._force.release()
        self._due_tick = -1  # at which the pull begins; -1: not known
        self.phase: Literal["held", "pulled", "released"] = "held"

    def let_go(self) -> None:
        """Release a vehicle that is put elsewhere."""
        self._force.release()
        self.phase = "released"

    def begin(self, tick: int, controls: list[float]) -> str | None:
        """Note the commands of a tick before it is flown; return what begins in it."""
        if self.phase != "held":
            return None
        launch = self._launch
        if self._due_tick < 0:
            if launch.at_s is not None:
                self._due_tick = round(launch.at_s * NS_PER_S / self._tick_ns)
            else:
                mean = sum(controls[: self._rotors]) / max(self._rotors, 1)
                if mean >= launch.throttle:
                    self._due_tick = tick + round(launch.delay_s * NS_PER_S / self._tick_ns)
        if self._due_tick < 0 or tick <= self._due_tick:
            return None
        force_n, stiffness_npm, length_m = launch.pull(self._mass_kg)
        self._force.engage(
            from_W_m=self.p_WB, along_W=self._along, force_n=force_n, stiffness_npm=stiffness_npm, length_m=length_m
        )
        self.phase = "pulled"
        return f"{launch.kind}: pull of {force_n:.0f} N over {length_m:g} m began"

    def keep(self, state: NDArray[np.float64]) -> str | None:
        """Keep the state after a tick on the rail; return what ended in it."""
        d, p = self._along, self.p_WB
        if self.phase == "held":
            way = speed = 0.0
        else:
            x, y, z = state[_P].tolist()
            u, v, w = state[_V].tolist()
            way = (x - p[0]) * d[0] + (y - p[1]) * d[1] + (z - p[2]) * d[2]
            speed = u * d[0] + v * d[1] + w * d[2]
            if way < 0.0:  # the stop at the rail's beginning
                way, speed = 0.0, max(speed, 0.0)
        state[_P] = (p[0] + way * d[0], p[1] + way * d[1], p[2] + way * d[2])
        state[_Q], state[_W] = self.q_WB, 0.0
        state[_V] = (speed * d[0], speed * d[1], speed * d[2])
        if self.phase == "pulled" and way >= self._length_m:
            self._force.release()
            self.phase = "released"
            return f"{self._launch.kind}: released at {speed:.2f} m/s"
        return None
