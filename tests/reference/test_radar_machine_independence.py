"""Frames of echoes have the same bits with CPU features masked and for every instruction set of the kernels."""

from __future__ import annotations

from tests import cpu_masks
from tests.cpu_masks import output_of

FRAMES = """
import hashlib
import numpy as np
from hil.signals.noise import NoiseStream
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.processing.parameters import Processing
from sim.radar.processing.processor import Processor
from sim.radar.synthesis import Synthesizer

RX = ((0.0, 0.0025, 0.0), (0.0, 0.0, 0.0025), (0.0, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.02, 0.0))
SETTINGS = dict(center_frequency_hz=60.8e9, bandwidth_hz=0.4e9, sample_rate_hz=2e6)
CHIRPS = (
    Chirp(**SETTINGS, samples=64, chirps=64, repetition_s=390.975e-6),
    Chirp(**SETTINGS, samples=50, chirps=27, repetition_s=500e-6),
)

CROWD = 9001

def echoes_of(count):
    stream = NoiseStream(SEED, "echoes")
    u = np.concatenate([stream.uniform_block(b)[:, 0] for b in range(6 * count // 256 + 1)])
    u = u[: 6 * count].reshape(6, count)
    direction = np.ascontiguousarray(u[:3].T * 1.1 - 0.55)
    amplitude = u[5] * u[5] * u[5] * u[5]
    amplitude[: count // 2] *= 1e-12
    range_m, speed_mps = u[3] * 40.0, u[4] * 16.0 - 8.0
    if count == CROWD:  # most in one cell: grids in single precision are emptied into doubles on the way
        range_m[200:], direction[200:] = 4.2, (1.0, 0.0, 0.0)
        speed_mps[200:] = 0.7 + 6.3053 * (np.arange(count - 200) % 3 - 1)
    return Echoes(range_m, speed_mps, direction, amplitude)

digest = hashlib.sha256()
for chirp in CHIRPS:
    for receivers in (3, 5):
        for method, tolerance, count in (
            ("direct", 1e-3, 203), ("nufft", 1e-1, 3001), ("nufft", 1e-3, 3001), ("nufft", 1e-9, 3001),
            ("nufft", 1e-3, 5), ("nufft", 1e-3, CROWD),
        ):
            synthesizer = Synthesizer(
                chirp, RX[:receivers], hp_cutoff_hz=80e3, aaf_cutoff_hz=600e3, method=method, tolerance=tolerance
            )
            out = np.empty(synthesizer.shape)
            report = synthesizer.synthesize(echoes_of(count), out)
            digest.update(out.tobytes())
            digest.update(repr(report).encode())
            raw = np.clip(2048.0 + 900.0 * out / np.abs(out).max(), 0, 4095).astype(np.uint16)
            processed = Processor(chirp, RX[:receivers], Processing(clutter="none")).process(raw, 0)
            for array in (processed.range_doppler, processed.points):
                digest.update(array.tobytes())
print(digest.hexdigest())
"""


def digest(seed: int = 1, environment: dict[str, str] | None = None) -> str:
    return output_of(FRAMES.replace("SEED", str(seed)), environment)


def test_masked_cpu_features_change_no_bit_of_a_frame() -> None:
    plain = digest()
    assert plain == digest(environment=cpu_masks.ALL | {"HIL_ISA": "base"})
    assert plain == digest(environment={"HIL_ISA": "avx2"})
    assert plain != digest(seed=2)
