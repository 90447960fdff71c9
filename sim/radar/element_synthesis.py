"""Synthesis of frames of an array whose transmitters and receivers differ (element_cuts.py), channel by channel.

A phase psi is a longer way: R grows by psi lambda / (4 pi), half a millimetre for a quarter of a turn at 77 GHz. Each
channel is a sum of its own over all echoes, so a frame takes the time of as many frames with one receiver. In time
division, the chirps of transmitter p of P are a frame of one transmitter with the middle (p - (P - 1) / 2) T_c off that
of all, where an echo is at R + v times this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.radar.antenna import Antenna
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.element_cuts import ElementCuts
from sim.radar.synthesis import Synthesizer
from sim.radar.virtual_array import VirtualArray

Float64 = NDArray[np.float64]

_FOUR_PI = 12.566370614359172


@dataclass(frozen=True)
class ChannelsReport:
    """The greatest figures of all channels."""

    echoes: int
    dropped: int
    dropped_bound: float
    terms: int


class ElementSynthesizer:
    """Synthesizer of an array whose elements differ, channel by channel. Not thread-safe."""

    def __init__(
        self,
        chirp: Chirp,
        antenna: Antenna,
        *,
        hp_cutoff_hz: float | None,
        aaf_cutoff_hz: float | None,
        method: str,
        tolerance: float,
    ) -> None:
        array = antenna.array
        self._tx = antenna.tx_cuts or (ElementCuts(),) * array.transmitters
        self._rx = antenna.rx_cuts or (ElementCuts(),) * len(array.rx_positions_m)
        self._chirp, self._turns, self._parts = chirp, array.turns, chirp.parts
        self._m_per_rad = chirp.wavelength_m / _FOUR_PI
        one = chirp.of_one_transmitter(array.turns)
        self._channels = [
            [
                Synthesizer(
                    one,
                    VirtualArray((r,), (t,)),
                    hp_cutoff_hz=hp_cutoff_hz,
                    aaf_cutoff_hz=aaf_cutoff_hz,
                    method=method,
                    tolerance=tolerance,
                )
                for r in array.rx_positions_m
            ]
            for t in array.tx_positions_m
        ]
        self._out = np.empty((chirp.parts, one.chirps, one.samples))

    def synthesize(self, echoes: Echoes, out: Float64) -> ChannelsReport:
        """Overwrite `out` (channels, chirps, samples) with the sum, as `Synthesizer` does."""
        leaves = echoes.direction_R if echoes.out_direction_R is None else echoes.out_direction_R
        receivers = [cuts.difference(echoes.direction_R) for cuts in self._rx]
        reports = []
        for p, (transmitter, row) in enumerate(zip(self._tx, self._channels, strict=True)):
            later_s = (p - 0.5 * (self._turns - 1)) * self._chirp.repetition_s
            range_m = echoes.range_m + echoes.speed_mps * later_s
            factor_p, phase_p = transmitter.difference(leaves)
            for k, ((factor_k, phase_k), synthesizer) in enumerate(zip(receivers, row, strict=True)):
                channel = Echoes(
                    range_m + (phase_p + phase_k) * self._m_per_rad,
                    echoes.speed_mps,
                    echoes.direction_R,
                    echoes.amplitude * factor_p * factor_k,
                    echoes.out_direction_R,
                )
                reports.append(synthesizer.synthesize(channel, self._out))
                out[k * self._parts : (k + 1) * self._parts, p :: self._turns] = self._out
        return ChannelsReport(
            max(r.echoes for r in reports),
            max(r.dropped for r in reports),
            max(r.dropped_bound for r in reports),
            max(r.terms for r in reports),
        )
