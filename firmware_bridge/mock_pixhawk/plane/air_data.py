"""Airspeed and wind, of which a plane's controller needs both.

Airspeed, the first that there is:
    pitot    HIL_SENSOR.diff_pressure (fields_updated 0x400): calibrated airspeed sqrt(2 q / rho_0), filtered
    wind     |velocity over ground - wind estimate|, once the wind is known
    ground   the speed over ground

True over calibrated airspeed is sqrt(rho_0 / rho), rho from the barometer in the standard atmosphere.

Wind: a Kalman filter of two states (north, east) that drift as a random walk, from two facts of straight flight through
the air (as PX4's wind estimator, J. Stastny's airspeed_selector): the plane flies where its nose points, so (v - w)
has no component across the heading; with a pitot its component along the heading is the true airspeed.
"""

from __future__ import annotations

from math import sqrt

from firmware_bridge.mock_pixhawk import elementary as el
from signals.units import STANDARD_GRAVITY_MPS2

_RHO_0 = 1.225
_PITOT_TIMEOUT_US = 1_000_000
_PITOT_TC_S = 0.1
_RATE_TC_S = 0.3
_STUCK_SAMPLES = 100  # equal samples of a sensor that works do not follow each other so often
_PA_PER_HPA = 100.0
_LAPSE_PER_KM, _T0 = 6.5, 288.15

_WIND_DRIFT = 0.1  # m/s/sqrt(s)
_SLIP_NOISE, _PITOT_NOISE = 2.0, 1.0  # m/s, of one sample; the samples are 20 ms apart and their errors last longer
_SAMPLES_TOGETHER = 25.0  # samples whose errors are one error
_KNOWN_STD = 1.5  # m/s, of the wind that is used for an airspeed
_MOST_WIND = 40.0


class Pitot:
    """Calibrated airspeed by differential pressure."""

    def __init__(self) -> None:
        self.airspeed_mps = 0.0
        self._last_us: int | None = None
        self._raw_hpa: float | None = None
        self._same = 0

    def take(self, t_us: int | None, difference_hpa: float | None) -> None:
        """Take the newest differential pressure and its time; the same time again is the same sample."""
        if t_us is None or difference_hpa is None or t_us == self._last_us:
            return
        self._same = self._same + 1 if difference_hpa == self._raw_hpa else 0
        self._raw_hpa = difference_hpa
        speed = sqrt(2.0 * max(difference_hpa, 0.0) * _PA_PER_HPA / _RHO_0)
        if self._last_us is None:
            self.airspeed_mps = speed
        else:
            dt = min(1e-6 * (t_us - self._last_us), 0.1)
            self.airspeed_mps += (speed - self.airspeed_mps) * dt / (dt + _PITOT_TC_S)
        self._last_us = t_us

    def healthy(self, now_us: int) -> bool:
        """Return True if samples come, and not always the same one."""
        return self._last_us is not None and now_us - self._last_us <= _PITOT_TIMEOUT_US and self._same < _STUCK_SAMPLES


def true_over_calibrated(altitude_m: float) -> float:
    """Return sqrt(rho_0 / rho) at an altitude in the standard atmosphere: rho / rho_0 = (T / T_0)^(g / (R L) - 1)."""
    t = max((_T0 - _LAPSE_PER_KM * 1e-3 * altitude_m) / _T0, 0.5)
    exponent = STANDARD_GRAVITY_MPS2 / (287.05 * _LAPSE_PER_KM * 1e-3) - 1.0
    return el.exp(-0.5 * exponent * el.log(t))


class WindEstimate:
    """Wind north and east [m/s] with its covariance."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the wind."""
        self.n_mps = self.e_mps = 0.0
        self._p = [25.0, 0.0, 25.0]  # nn, ne, ee

    @property
    def known(self) -> bool:
        """True if the wind is known well enough for an airspeed."""
        return max(self._p[0], self._p[2]) < _KNOWN_STD * _KNOWN_STD

    def step(self, *, ground_mps: tuple[float, float], yaw_rad: float, airspeed_mps: float | None, dt_s: float) -> None:
        """Take the velocity over ground, the heading and the true airspeed (None: not measured) of a step in flight."""
        p = self._p
        p[0] += _WIND_DRIFT * _WIND_DRIFT * dt_s
        p[2] += _WIND_DRIFT * _WIND_DRIFT * dt_s
        c, s = el.cos(yaw_rad), el.sin(yaw_rad)
        g_n, g_e = ground_mps
        self._fuse(-s, c, -s * g_n + c * g_e, _SLIP_NOISE * _SLIP_NOISE * _SAMPLES_TOGETHER)
        if airspeed_mps is not None:
            self._fuse(c, s, c * g_n + s * g_e - airspeed_mps, _PITOT_NOISE * _PITOT_NOISE * _SAMPLES_TOGETHER)
        self.n_mps = min(max(self.n_mps, -_MOST_WIND), _MOST_WIND)
        self.e_mps = min(max(self.e_mps, -_MOST_WIND), _MOST_WIND)

    def _fuse(self, h_n: float, h_e: float, measured: float, variance: float) -> None:
        nn, ne, ee = self._p
        a, b = nn * h_n + ne * h_e, ne * h_n + ee * h_e
        s = h_n * a + h_e * b + variance
        innovation = measured - (h_n * self.n_mps + h_e * self.e_mps)
        self.n_mps += a / s * innovation
        self.e_mps += b / s * innovation
        self._p = [nn - a * a / s, ne - a * b / s, ee - b * b / s]


class AirData:
    """Airspeed, its rate and the wind of one plane. `source` tells where the airspeed comes from."""

    def __init__(self, *, pitot: bool) -> None:
        """`pitot`: FW_USE_AIRSPD, the pitot may be used."""
        self.pitot, self.wind = Pitot(), WindEstimate()
        self.use_pitot = pitot
        self.source = "ground"
        self.airspeed_mps = 0.0  # calibrated
        self.true_mps = 0.0
        self.ratio = 1.0  # true over calibrated
        self.rate_mps2 = 0.0  # of the true airspeed
        self._last_us: int | None = None

    def step(
        self,
        now_us: int,
        *,
        ground_NED_mps: tuple[float, float, float],
        acceleration_NED_mps2: tuple[float, float, float],
        yaw_rad: float,
        altitude_m: float,
        flying: bool,
    ) -> None:
        """Take the estimator's motion of a guidance step."""
        dt = 0.0 if self._last_us is None else min(1e-6 * (now_us - self._last_us), 0.1)
        self._last_us = now_us
        n, e, d = ground_NED_mps
        self.ratio = true_over_calibrated(altitude_m)
        pitot = self.use_pitot and self.pitot.healthy(now_us)
        measured = self.pitot.airspeed_mps * self.ratio if pitot else None
        if flying:
            self.wind.step(ground_mps=(n, e), yaw_rad=yaw_rad, airspeed_mps=measured, dt_s=dt)
        else:
            self.wind.reset()
        w_n, w_e = self.wind_mps
        a_n, a_e = n - w_n, e - w_e
        through_air = sqrt(a_n * a_n + a_e * a_e + d * d)
        if measured is not None:
            self.source, self.true_mps = "pitot", measured
        else:
            self.source, self.true_mps = "wind" if self.wind.known else "ground", through_air
        self.airspeed_mps = self.true_mps / self.ratio
        # The derivative of the airspeed is the acceleration along the air velocity: less noise than a difference.
        if through_air > 1.0:
            x, y, z = acceleration_NED_mps2
            raw = (x * a_n + y * a_e + z * d) / through_air
            self.rate_mps2 += (raw - self.rate_mps2) * dt / (dt + _RATE_TC_S)

    @property
    def wind_mps(self) -> tuple[float, float]:
        """Wind north and east; zero while it is not known."""
        return (self.wind.n_mps, self.wind.e_mps) if self.wind.known else (0.0, 0.0)
