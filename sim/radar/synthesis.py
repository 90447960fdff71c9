"""Synthesis of a frame's noise-free samples: the sum of the echoes with the exact phase of a dechirped FMCW radar.

An echo at range R and radial speed v (+ receding) at the middle of the frame has the delay tau = 2 (R + v t) / c. For
receiver k at r_k and direction d_R, with f_0 the start of the sweep, S its slope, t_n = n / f_s, lambda = c / f_c and
f_b = S 2 R / c:

    x[k, m, n] = sum of A |H(f_b)| cos(2 pi (f_0 tau + S t_n tau - S tau^2 / 2) - 2 pi r_k . d_R / lambda + arg H(f_b))

    H(f) = j f / (f_hp + j f) / (1 + j f / f_aaf)      first order each; either can be off

With complex samples, a receiver's second channel is the same sum of sines. With transmitters at t_p, r_k becomes t_p +
r_k for those that transmit in chirp m: of P in time division m mod P alone, in Doppler division all of them, each with
the additional phase p m / `doppler_bands` cycles. An echo that leaves in another direction d_out than it
comes back from has t_p . d_out + r_k . d_R.

`direct` evaluates this sum in double precision and is the reference. `nufft` is a non-uniform FFT with the error
||x - x_direct|| / ||x_direct|| <= `tolerance` over the whole frame. Method: sim/native/radar/synthesis.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signals.samples import Vec3
from sim._kernels import EchoSynthesis, EchoSynthesisReport
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.virtual_array import VirtualArray

METHODS = ("direct", "nufft")
MIN_TOLERANCE, MAX_TOLERANCE = 1e-12, 0.1
MAX_RECEIVERS, MAX_TRANSMITTERS = 16, 12  # limits of the kernels: sim/native/radar/echo_model.hpp
ORIGIN: Vec3 = (0.0, 0.0, 0.0)


class Synthesizer:
    """Summation of echoes to frames of one chirp. Not thread-safe.

    `array`: the places of the receivers, or a `VirtualArray` with several transmitters.
    `drop_share`: share of the tolerance for dropping the weakest echoes; 0 drops none. `isa`: instruction set of the
    kernels; all give the same bits. Raises ValueError for arguments out of range.
    """

    def __init__(
        self,
        chirp: Chirp,
        array: VirtualArray | Sequence[Vec3],
        *,
        hp_cutoff_hz: float | None,
        aaf_cutoff_hz: float | None,
        method: str = "nufft",
        tolerance: float = 1e-3,
        drop_share: float = 0.5,
        isa: str = "",
    ) -> None:
        if method not in METHODS:
            raise ValueError(f"no synthesis method {method!r}; methods: {', '.join(METHODS)}")
        if not MIN_TOLERANCE <= tolerance <= MAX_TOLERANCE:
            raise ValueError(f"tolerance must lie in [{MIN_TOLERANCE:g}, {MAX_TOLERANCE:g}], not {tolerance:g}")
        if not 0.0 <= drop_share < 1.0:
            raise ValueError(f"drop_share must lie in [0, 1), not {drop_share:g}")
        for name, cutoff_hz in (("hp_cutoff_hz", hp_cutoff_hz), ("aaf_cutoff_hz", aaf_cutoff_hz)):
            if cutoff_hz is not None and not 0.0 < cutoff_hz <= 1e12:
                raise ValueError(f"{name} must lie in (0, 1e12], or be None for no filter, not {cutoff_hz:g}")
        if not isinstance(array, VirtualArray):
            array = VirtualArray(tuple(array))
        rx = _positions("rx_positions_m", array.rx_positions_m, MAX_RECEIVERS)
        tx = _positions("tx_positions_m", array.tx_positions_m, MAX_TRANSMITTERS)
        doppler_bands = array.doppler_bands
        if doppler_bands and not len(tx) <= doppler_bands <= chirp.chirps:
            raise ValueError(
                f"doppler_bands must be 0, or from the number of transmitters to that of chirps, not {doppler_bands}"
            )
        if not doppler_bands and (chirp.chirps % len(tx) or chirp.chirps < 2 * len(tx)):
            raise ValueError(f"{chirp.chirps} chirps are not two or more for each of {len(tx)} transmitters")
        self.chirp, self.method, self.tolerance = chirp, method, tolerance
        self.shape = (len(rx) * chirp.parts, chirp.chirps, chirp.samples)
        self._synthesis = EchoSynthesis(
            center_frequency_hz=chirp.center_frequency_hz,
            bandwidth_hz=chirp.bandwidth_hz,
            sample_rate_hz=chirp.sample_rate_hz,
            repetition_s=chirp.repetition_s,
            samples=chirp.samples,
            chirps=chirp.chirps,
            tx_positions_m=tx,
            rx_positions_m=rx,
            doppler_bands=doppler_bands,
            complex_samples=chirp.sampling == "complex",
            hp_cutoff_hz=hp_cutoff_hz or 0.0,
            aaf_cutoff_hz=aaf_cutoff_hz or 0.0,
            direct=method == "direct",
            tolerance=tolerance,
            drop_share=drop_share,
            isa=isa,
        )

    def synthesize(self, echoes: Echoes, out: NDArray[np.float64]) -> EchoSynthesisReport:
        """Overwrite `out` (channels, chirps, samples) with the sum, in the amplitude's unit; return a report.

        Raises ValueError for arrays of another type or shape, and for the first echo that is not finite or out of
        range.
        """
        n = len(echoes.range_m)
        _check("range_m", echoes.range_m, (n,))
        _check("speed_mps", echoes.speed_mps, (n,))
        _check("direction_R", echoes.direction_R, (n, 3))
        _check("amplitude", echoes.amplitude, (n,))
        if echoes.out_direction_R is not None:
            _check("out_direction_R", echoes.out_direction_R, (n, 3))
        _check("out", out, self.shape)
        if not out.flags.writeable:
            raise ValueError("out must be writable")
        return self._synthesis.synthesize(
            echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude, echoes.out_direction_R, out
        )


def _positions(name: str, positions_m: Sequence[Vec3], most: int) -> list[tuple[float, float, float]]:
    positions = [tuple(float(x) for x in p) for p in positions_m]
    if not 1 <= len(positions) <= most:
        raise ValueError(f"{name} must have 1 to {most} places, not {len(positions)}")
    if any(len(p) != 3 or not all(math.isfinite(x) and abs(x) <= 10.0 for x in p) for p in positions):
        raise ValueError(f"{name} must be triples within 10 m of the radar, not {positions}")
    return [(x, y, z) for x, y, z in positions]


def _check(name: str, array: NDArray[np.float64], shape: tuple[int, ...]) -> None:
    if array.dtype != np.float64 or array.shape != shape or not array.flags.c_contiguous:
        raise ValueError(
            f"{name} must be a C-contiguous float64 array of shape {shape}, not {array.dtype} of shape {array.shape}"
            + ("" if array.flags.c_contiguous else ", not contiguous")
        )
