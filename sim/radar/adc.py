"""Receiver chain: adds impairments to the beat signal of the echoes and converts it to raw samples.

Noise is drawn from named streams by the number of the frame (sim/native/image_noise.hpp):

    <name>.noise.rx<k>       normal m N + n of picture `seq` for sample n of chirp m of receiver k = 1, 2, ...
    <name>.dc_wander.rx<k>   normal m of picture `seq`

so switching an impairment or adding a receiver changes no other noise. White noise gets the power S by circular
convolution with h over a chirp's N samples,

    h[n] = (1/N) sum_b sqrt(S_b) cos(2 pi b n / N),   |DFT(h)[b]|^2 = S_b,

and is then multiplied by the envelope g over the chirp. With the same power in all bins, h is its root at 0 alone.
With complex samples a receiver is two channels of the converter, `rx<k>` is the k-th channel.

The native kernel (sim/native/radar/receiver_noise.hpp) gives the same bits with every instruction set.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_cos, det_exp
from signals.noise import noise_key
from sim._kernels import RadarReceiver
from sim.radar.chirp import Chirp
from sim.radar.impairments import Adc, Impairments, ReceiverNoise

Float64 = NDArray[np.float64]
Codes = NDArray[np.uint16]


class RadarReceiverChain:
    """Conversion of frames of the noise-free signal [counts] to codes.

    `n_rx`: number of receivers, or of their channels with complex samples. Raises ValueError if the impairments do not
    fit the chirp or this number.
    """

    def __init__(
        self,
        chirp: Chirp,
        impairments: Impairments,
        n_rx: int,
        *,
        seed: int,
        name: str,
        adc_bits: int = 12,
        isa: str = "",
    ) -> None:
        problems = impairments.problems_with(chirp, n_rx)
        if problems:
            raise ValueError("impairments." + "; impairments.".join(problems))
        self.shape = (n_rx, chirp.chirps, chirp.samples)
        self._compression = impairments.compression
        leakage, start, wander = impairments.leakage, impairments.frame_start, impairments.dc_wander
        if leakage is None:
            fixed = [[0.5 * 2**adc_bits] * chirp.samples] * n_rx
        else:
            fixed = [[dc + y for y in row] for dc, row in zip(leakage.dc, leakage.sweep.at(chirp), strict=True)]
        self._native = RadarReceiver(
            receivers=n_rx,
            chirps=chirp.chirps,
            samples=chirp.samples,
            fixed=fixed,
            start=start.sweep.at(chirp) if start else [],
            decay=[det_exp(-m * chirp.repetition_s / start.decay_s) for m in range(chirp.chirps)] if start else [],
            colour=_colours(impairments.noise, chirp, n_rx) if impairments.noise else [],
            envelope=_envelopes(impairments.noise, chirp, n_rx) if impairments.noise else [],
            colour_key=[noise_key(seed, f"{name}.noise.rx{k + 1}") for k in range(n_rx)],
            wander=wander.sigma if wander else [],
            wander_key=[noise_key(seed, f"{name}.dc_wander.rx{k + 1}") for k in range(n_rx)],
            odd_width=2.0 * (impairments.adc or Adc(odd_code_share=0.5)).odd_code_share,
            bits=adc_bits,
            isa=isa,
        )

    def digitise(self, signal: Float64, seq: int, out: Codes) -> None:
        """Write the codes of frame `seq` to `out`, both (n_rx, M, N). Raises ValueError if a sample is not finite."""
        if self._compression is not None:
            ratio = signal / self._compression.limit_counts
            signal = signal / np.sqrt(1.0 + ratio * ratio)
        index = self._native.digitise(signal, seq, out)  # of the first sample that is not finite; -1: none
        if index >= 0:
            k, m, n = (int(i) for i in np.unravel_index(index, self.shape))
            raise ValueError(
                f"sample {n} of chirp {m} of receiver {k + 1} is {signal[k, m, n]}: a beat signal must be finite"
            )


def _colours(noise: ReceiverNoise, chirp: Chirp, receivers: int) -> list[list[float]]:
    """Return h of each receiver; its first value alone for white noise."""
    n = chirp.samples
    cosine = np.array([det_cos(2.0 * pi * i / n) for i in range(n)])
    indices = np.arange(n)
    rows = []
    for k in range(receivers):
        if len(set(noise.power[k])) == 1:
            rows.append([sqrt(noise.power[k][0])])
            continue
        h = np.zeros(n)
        for b in range(n // 2 + 1):
            bins = 1.0 if b in (0, n // 2) else 2.0  # b and -b
            amplitude = sqrt(noise.power_at(k, b * chirp.sample_rate_hz / n))
            h += bins * amplitude * cosine[b * indices % n]  # elementwise: the same rounding on every machine
        rows.append((h / n).tolist())
    return rows


def _envelopes(noise: ReceiverNoise, chirp: Chirp, receivers: int) -> list[list[float]]:
    """Return g of each receiver."""
    shares = [(n + 0.5) / chirp.samples for n in range(chirp.samples)]
    return [[noise.envelope_at(k, share) for share in shares] for k in range(receivers)]
