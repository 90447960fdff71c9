"""The radar's equation in extended precision, term by term, to tell the error of the method `direct` itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.bench_suite.radar_cases import synthesizer
from hil.bench_suite.radar_rivals import if_response
from sim.radar.chirp import SPEED_OF_LIGHT_MPS
from sim.radar.echoes import Echoes
from sim.sensors.radar_parameters import RadarParameters

_TURN = np.longdouble("6.283185307179586476925286766559005768")
_ECHOES = 60  # of all: extended precision takes a hundred times as long


def exact_error(p: RadarParameters, echoes: Echoes) -> float:
    """Relative error of `direct` over some of the echoes, evenly taken."""
    step = max(1, len(echoes.range_m) // _ECHOES)
    some = Echoes(
        *(
            np.ascontiguousarray(a[::step])
            for a in (echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude)
        )
    )
    c = p.chirp
    out = np.empty((len(p.antenna.rx_positions_m), c.chirps, c.samples))
    synthesizer(p, "direct", p.tolerance).synthesize(some, out)
    exact = exact_frame(p, some)
    return float(np.linalg.norm(out - exact) / np.linalg.norm(exact))


def exact_frame(p: RadarParameters, echoes: Echoes) -> NDArray[np.float64]:
    """(receivers, chirps, samples): the sum over echoes, phases in cycles in extended precision."""
    c, light = p.chirp, np.longdouble(SPEED_OF_LIGHT_MPS)
    fs, f0, slope = (np.longdouble(x) for x in (c.sample_rate_hz, c.start_frequency_hz, c.slope_hz_per_s))
    n = np.arange(c.samples, dtype=np.longdouble)
    m = np.arange(c.chirps, dtype=np.longdouble)[:, None]
    t = (m - np.longdouble(0.5) * (c.chirps - 1)) * np.longdouble(c.repetition_s)
    t = t + (n - np.longdouble(0.5) * (c.samples - 1)) / fs
    response = if_response(c, echoes.range_m, p.receiver.hp_cutoff_hz, p.receiver.aaf_cutoff_hz)
    gain, lag = np.abs(response), np.angle(response) / (2.0 * np.pi)
    out = np.zeros((len(p.antenna.rx_positions_m), c.chirps, c.samples), np.longdouble)
    for i in range(len(echoes.range_m)):
        tau = 2.0 * (np.longdouble(echoes.range_m[i]) + np.longdouble(echoes.speed_mps[i]) * t) / light
        cycles = f0 * tau + slope * (n / fs) * tau - 0.5 * slope * tau * tau + np.longdouble(lag[i])
        for k, r in enumerate(p.antenna.rx_positions_m):
            away = np.dot(np.asarray(r, np.longdouble), echoes.direction_R[i].astype(np.longdouble))
            turned = cycles - away * np.longdouble(c.center_frequency_hz) / light
            out[k] += echoes.amplitude[i] * gain[i] * np.cos(_TURN * (turned - np.rint(turned)))
    return out.astype(np.float64)
