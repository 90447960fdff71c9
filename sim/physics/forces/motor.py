"""Motor and speed controller of a rotor, and the speeds at which they balance its static torque.

Equations: sim/native/forces/motor.hpp. At a steady speed O in still air the current carries torque and friction,

    I = Q / K + I_0 O / (O + O_f),   Q = m_ratio k O^2

and the duty cycle u follows from u V = K O + R x, where x is the current of a motor that is switched both ways: x = I
with active braking, else I = (x + sqrt(x^2 + (u I_r)^2)) / 2.
"""

from __future__ import annotations

import math
from typing import Annotated, Protocol

from pydantic import Field

from signals.documents.validate import StrictModel

FRICTION_SPEED_RADPS = 20.0  # O_f
CONDUCTION_SHARE = 0.02  # I_r over V_nominal / R
_BISECTIONS = 60


class Motor(StrictModel):
    """Brushless motor and speed controller of each rotor. The battery's `efficiency` says nothing of them."""

    kv_rpm_per_v: Annotated[float, Field(gt=1.0, le=100_000.0)]
    resistance_ohm: Annotated[float, Field(gt=1e-4, le=100.0)]  # motor between two leads, and the controller's switches
    no_load_current_a: Annotated[float, Field(ge=0.0, le=100.0)]
    nominal_voltage_v: Annotated[float, Field(gt=0.0, le=1000.0)]  # of the supply without a battery; that of a battery
    active_braking: bool = True  # complementary switching ("damped light"): slows the rotor and feeds the battery

    @property
    def speed_per_volt_radps(self) -> float:
        """Return 1 / K."""
        return self.kv_rpm_per_v * 2.0 * math.pi / 60.0


class DrivenRotor(Protocol):
    """The part of `RotorConstants` that the steady state takes."""

    @property
    def thrust_coefficient_n_per_radps2(self) -> float: ...
    @property
    def moment_ratio_m(self) -> float: ...
    @property
    def inertia_kgm2(self) -> float: ...


def steady_duty(c: DrivenRotor, motor: Motor, speed_radps: float, density_ratio: float = 1.0) -> float:
    """Return the duty cycle that holds a speed in still air at nominal voltage; above 1 the voltage is too low."""
    K, R, V = 1.0 / motor.speed_per_volt_radps, motor.resistance_ohm, motor.nominal_voltage_v
    torque = density_ratio * c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * speed_radps * speed_radps
    current = torque / K + motor.no_load_current_a * speed_radps / (speed_radps + FRICTION_SPEED_RADPS)
    wanted_v = K * speed_radps + R * current
    if motor.active_braking or current <= 0.0:
        return wanted_v / V
    # x = I - (u I_r)^2 / 4 I
    blur = CONDUCTION_SHARE * V / R
    bend = R * blur * blur / (4.0 * current)
    return 2.0 * wanted_v / (V + math.sqrt(V * V + 4.0 * bend * wanted_v))


def steady_speed_radps(c: DrivenRotor, motor: Motor, duty: float, density_ratio: float = 1.0) -> float:
    """Return the speed in still air at a duty cycle 0..1 and nominal voltage."""
    low, high = 0.0, 1.1 * motor.nominal_voltage_v * motor.speed_per_volt_radps
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if steady_duty(c, motor, middle, density_ratio) < duty:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high) if duty > 0.0 else 0.0


def lag_s(c: DrivenRotor, motor: Motor, speed_radps: float) -> float:
    """Return the time constant of small changes about a speed in still air, with a current that flows."""
    K = 1.0 / motor.speed_per_volt_radps
    friction = K * motor.no_load_current_a * FRICTION_SPEED_RADPS / (speed_radps + FRICTION_SPEED_RADPS) ** 2
    load = 2.0 * c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * speed_radps
    return c.inertia_kgm2 / (K * K / motor.resistance_ohm + friction + load)


def curve_factor(duty: float, thrust_share: float) -> float:
    """Return f of the thrust curve f u^2 + (1 - f) u through 0, 1 and this point, within 0..1."""
    if not 0.0 < duty < 1.0:
        return 1.0
    return min(1.0, max(0.0, (duty - thrust_share) / (duty - duty * duty)))
