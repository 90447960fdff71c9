"""A simulated recording beside a real one: fitted on the first half of its frames, judged on the second.

The recording is the user's: HIL_RADAR_RECORDING names its .npz or .npy file. Without one this part is left out.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hil.bench_suite.result import BenchmarkResult, Check
from sim.radar.adc import RadarReceiverChain
from sim.radar.calibration import calibrate
from sim.radar.comparison import compare
from sim.radar.recording import load_recording

VARIABLE = "HIL_RADAR_RECORDING"


def recording_checks(result: BenchmarkResult) -> list[Check]:
    """Noise, odd codes, and every NCC beside real-against-real."""
    named = os.environ.get(VARIABLE)
    if not named:
        result.left_out.append(f"a real recording: set {VARIABLE} to its file")
        return []
    recording = load_recording(Path(named))
    half = recording.frames // 2
    # What stands in the scene stays in the fixed pattern: there is nothing else to simulate.
    fitted = calibrate(recording, frames=(0, half), keep_echoes=True, where=named)
    real = recording.adc[half:]
    chain = RadarReceiverChain(recording.chirp, fitted.impairments, real.shape[1], seed=1, name="radar")
    nothing, simulated = np.zeros(real.shape[1:]), np.empty(real.shape, np.uint16)
    for k in range(len(real)):
        chain.digitise(nothing, k, simulated[k])
    found = compare(simulated, real)
    checks = []
    for name, both in found.ncc.items():
        label = f"NCC {name}: {both.simulated_against_real:.3f}, real against real {both.real_against_real:.3f}: apart"
        checks.append(Check(label, abs(both.difference), "<=", 0.02, "1"))
    simulated_odd, real_odd = found.odd_code_share
    return [
        *checks,
        Check("noise power, worst bin", float(np.abs(found.noise_power_db).max()), "<=", 0.5, "dB"),
        Check("range-Doppler noise", float(np.abs(found.range_doppler_noise_db).max()), "<=", 0.5, "dB"),
        Check(
            f"odd codes, off those of the recording ({real_odd:.3f})", abs(simulated_odd - real_odd), "<=", 0.02, "1"
        ),
    ]
