"""Wind against MIL-F-8785C: scales, variances, spectra; gust shape; streams and events."""

from __future__ import annotations

import math

import numpy as np
import pydantic
import pytest

from sim._kernels import dryden_scale
from sim.physics import multirotor
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
from sim.scene.wind import GustEvent, Turbulence, Wind, WindAtVehicle
from tests.worlds.rotor_models import quadratic

TICK_NS = 4_000_000
FOOT = 0.3048


def samples(wind: Wind, ticks: int, *, height_m: float, airspeed: float, tick_ns: int, seed: int = 1) -> np.ndarray:
    x, y, z = wind.steady_W_mps
    met = WindAtVehicle(wind, seed=seed, tick_ns=tick_ns)
    values = [met.start(height_m)]
    values += [met.at(tick, height_m, (x + airspeed, y, z)) for tick in range(1, ticks)]
    return np.array(values)


@pytest.mark.parametrize("height_ft", [20.0, 200.0, 1000.0])
def test_scales_of_the_standard(height_ft: float) -> None:
    """MIL-F-8785C 3.7.3: heights in feet, intensity by the wind at 20 ft."""
    sigma_uv, sigma_w, length_uv, length_w = dryden_scale(height_ft * FOOT, 15.0)
    shape = 0.177 + 0.000823 * height_ft
    assert sigma_w == pytest.approx(1.5)
    assert sigma_uv == pytest.approx(1.5 / shape**0.4, rel=1e-12)
    assert length_w == pytest.approx(height_ft * FOOT)
    assert length_uv == pytest.approx(height_ft * FOOT / shape**1.2, rel=1e-12)
    if height_ft == 1000.0:  # where the standard's two ranges meet: isotropic
        assert sigma_uv == pytest.approx(sigma_w, rel=1e-4)
        assert length_uv == pytest.approx(length_w, rel=1e-3)


def test_scales_are_held_beyond_the_models_heights() -> None:
    assert dryden_scale(0.0, 10.0) == dryden_scale(10 * FOOT, 10.0)
    assert dryden_scale(5000.0, 10.0) == dryden_scale(1000 * FOOT, 10.0)


def test_variance_and_spectrum_are_the_standards() -> None:
    """Spectra of the forming filters, one-sided in Hz, at 25 m height, 12 m/s, against Welch's estimate."""
    rough = Wind(turbulence=Turbulence(wind_20ft_mps=10.0))
    height, V, dt, n = 25.0, 12.0, 0.05, 400_000
    u = samples(rough, n, height_m=height, airspeed=V, tick_ns=50_000_000)
    sigma_uv, sigma_w, length_uv, length_w = dryden_scale(height, 10.0)
    # 20,000 s hold hundreds of correlation times.
    assert u.std(axis=0) == pytest.approx([sigma_uv, sigma_uv, sigma_w], rel=0.05)
    from scipy.signal import welch  # here, as every process that collects tests imports the rest

    f, power = welch(u, fs=1 / dt, nperseg=4096, axis=0)
    band = (f > 0.02) & (f < 2.0)
    for axis, sigma, length, first_order in (
        (0, sigma_uv, length_uv, True),
        (1, sigma_uv, length_uv, False),
        (2, sigma_w, length_w, False),
    ):
        x = (2 * math.pi * f[band] * length / V) ** 2
        shape = 2 / (1 + x) if first_order else (1 + 3 * x) / (1 + x) ** 2
        exact = 2 * sigma**2 * length / V * shape
        ratio = power[band, axis] / exact
        assert np.mean(ratio) == pytest.approx(1.0, abs=0.05), axis
        # No slope left: a wrong corner or a wrong filter tilts it.
        assert abs(np.polyfit(np.log(f[band]), np.log(ratio), 1)[0]) < 0.05, axis


def test_turbulence_lies_along_the_wind() -> None:
    """With the wind to the north, north is the longitudinal axis: at 6 m its spectrum reaches lower than east's."""
    seen = []
    for steady in ((8.0, 0.0, 0.0), (0.0, 8.0, 0.0)):
        wind = Wind(steady_W_mps=steady, turbulence=Turbulence(level="light"))
        seen.append(samples(wind, 50, height_m=6.0, airspeed=5.0, tick_ns=TICK_NS) - np.array(steady))
    east, north = seen
    assert north[:, 1] == pytest.approx(east[:, 0], abs=1e-12)
    assert north[:, 0] == pytest.approx(-east[:, 1], abs=1e-12)
    assert north[:, 2] == pytest.approx(east[:, 2], abs=1e-12)


def test_same_seed_same_wind() -> None:
    rough = Wind(turbulence=Turbulence(level="severe"))
    one, again, other = (
        samples(rough, 100, height_m=50.0, airspeed=3.0, tick_ns=TICK_NS, seed=s).tolist() for s in (1, 1, 2)
    )
    assert one == again
    assert one != other


def test_gust_is_one_minus_cosine() -> None:
    gust = GustEvent(at_s=1.0, velocity_W_mps=(8.0, 0.0, 0.0), rise_s=0.4, hold_s=0.2, fall_s=0.8)
    for t_s, share in ((0.9, 0.0), (1.0, 0.0), (1.1, 0.5 * (1 - math.sqrt(0.5))), (1.2, 0.5), (1.4, 1.0), (1.59, 1.0)):
        assert gust.strength(round(t_s * 1e9)) == pytest.approx(share, abs=1e-12)
    for t_s, share in ((1.6, 1.0), (1.8, 0.5 * (1 + math.sqrt(0.5))), (2.0, 0.5), (2.4, 0.0), (9.0, 0.0)):
        assert gust.strength(round(t_s * 1e9)) == pytest.approx(share, abs=1e-12)
    front = gust.model_copy(update={"fall_s": None})
    assert front.strength(10**12) == 1.0


def test_gust_reaches_the_vehicle_and_the_events() -> None:
    wind = Wind(gusts=(GustEvent(at_s=0.1, velocity_W_mps=(10.0, 0.0, 0.0), rise_s=0.2, fall_s=0.1),))
    vehicle = quadratic("x500")
    physics = VehiclePhysics(
        vehicle,
        load_scene("airfield"),
        TICK_NS,
        start=FlightStart(p_WB=(0.0, 0.0, 100.0)),
        disturbances=Disturbances(wind=wind),
    )
    physics.state[13:] = multirotor.speed_radps(vehicle, multirotor.hover_control(vehicle))
    happened = []
    for tick in range(150):
        truth = physics.advance(tick, (multirotor.hover_control(vehicle),) * 4)
        happened += physics.take_events()
        if tick <= 25:
            assert truth.v_WB_W == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert [(event.t_ns, event.kind) for event in happened] == [(100_000_000, "gust"), (400_000_000, "gust")]
    assert "(10, 0, 0) m/s" in happened[0].text
    assert happened[1].text == "gust is over"
    assert truth.v_WB_W[0] > 0.05
    assert physics.wind_W_mps == (0.0, 0.0, 0.0)


def test_hovering_in_calm_air_still_meets_turbulence() -> None:
    rough = Wind(turbulence=Turbulence(level="moderate"))
    still = samples(rough, 20_000, height_m=6.0, airspeed=0.0, tick_ns=100_000_000)
    assert still.std(axis=0).min() > 0.5


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"turbulence": {"level": "stormy"}}, "light"),
        ({"turbulence": {}}, "either level or wind_20ft_mps"),
        ({"turbulence": {"level": "light", "wind_20ft_mps": 3.0}}, "either level or wind_20ft_mps"),
        ({"gusts": [{"at_s": -1.0, "velocity_W_mps": [1.0, 0.0, 0.0], "rise_s": 1.0}]}, "at_s"),
        ({"gusts": [{"at_s": 1.0, "velocity_W_mps": [1.0, 0.0, 0.0], "rise_s": 0.0}]}, "rise_s"),
        ({"steady_W_mps": [80.0, 0.0, 0.0]}, "less than or equal to 50"),
        ({"stedy_W_mps": [8.0, 0.0, 0.0]}, "stedy_W_mps"),
    ],
)
def test_wrong_wind_is_refused_by_name(data: dict[str, object], said: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=said):
        Wind.model_validate(data)


def test_turbulence_depends_on_the_airspeed_whatever_its_direction() -> None:
    def sampled(steady: tuple[float, float, float], v_WB_W: tuple[float, float, float]) -> tuple[float, float, float]:
        wind = WindAtVehicle(
            Wind(steady_W_mps=steady, turbulence=Turbulence(level="severe")), seed=1, tick_ns=4_000_000
        )
        wind.start(50.0)
        for tick in range(1, 200):
            blown = wind.at(tick, 50.0, v_WB_W)
        return tuple(b - s for b, s in zip(blown, steady, strict=True))  # type: ignore[return-value]

    along = sampled((3.0, 0.0, 0.0), (3.0, 0.0, 9.0))
    assert along == pytest.approx(sampled((3.0, 0.0, 0.0), (12.0, 0.0, 0.0)), rel=1e-12)
    assert along == pytest.approx(sampled((3.0, 0.0, 0.0), (3.0, -9.0, 0.0)), rel=1e-12)
    assert along != pytest.approx(sampled((3.0, 0.0, 0.0), (3.0, 0.0, 3.0)), rel=1e-3)
