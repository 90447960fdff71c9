"""Radar frames as numpy files.

raw             uint16 (receivers, chirps, samples): ADC counts
range_doppler   float32 (chirps, samples / 2): power in ADC counts squared; rows by speed, zero in the middle
radar.json      the chirp with the keys of `sim.radar.recording`, and the quantities derived from it
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import RecordingError
from sim.radar.chirp import Chirp
from sim.radar.recording import device_config

CONFIG_NAME = "radar.json"


def npy(array: NDArray[Any]) -> bytes:
    """Return a numpy file (version 1.0), little endian, C order. Raises RecordingError for arrays of objects."""
    if array.dtype.hasobject:
        raise RecordingError("a numpy file of a data set holds numbers, not objects")
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(array, array.dtype.newbyteorder("<")), allow_pickle=False)
    return file.getvalue()


def radar_json(chirp: Chirp, rx_antennas: Sequence[int], *, rate_hz: float) -> str:
    """Return radar.json, which `hil radar` reads back. `rx_antennas` are the receivers' numbers, from 1."""
    config = {
        **device_config(chirp, rx_antennas, frame_repetition_s=1.0 / rate_hz),
        "raw": {"dtype": "uint16", "axes": ["receiver", "chirp", "sample"], "unit": "ADC count"},
        "range_doppler": {
            "dtype": "float32",
            "axes": ["speed", "range"],
            "unit": "ADC count squared",
            "range_step_m": chirp.range_resolution_m,
            "speed_step_mps": chirp.speed_resolution_mps,
            "zero_speed_row": chirp.chirps // 2,
        },
        "max_range_m": chirp.max_range_m,
        "max_speed_mps": chirp.max_speed_mps,
        "wavelength_m": chirp.wavelength_m,
    }
    return json.dumps(config, indent=2) + "\n"
