"""Radar frames as numpy files.

raw             uint16 (channels, chirps, samples): ADC counts; a channel is a receiver, or half of one with complex
                samples, whose in-phase part comes first
range_doppler   float32 (chirps, samples / 2): power in ADC counts squared; rows by speed, zero in the middle
radar.json      the chirp with the keys of `sim.radar.recording`, and the quantities derived from it
"""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import RecordingError
from sim.radar.chirp import Chirp
from sim.radar.processing.parameters import power_of_two_from
from sim.radar.recording import device_config
from sim.radar.virtual_array import VirtualArray

CONFIG_NAME = "radar.json"


def npy(array: NDArray[Any]) -> bytes:
    """Return a numpy file (version 1.0), little endian, C order. Raises RecordingError for arrays of objects."""
    if array.dtype.hasobject:
        raise RecordingError("a numpy file of a data set holds numbers, not objects")
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(array, array.dtype.newbyteorder("<")), allow_pickle=False)
    return file.getvalue()


def radar_json(chirp: Chirp, array: VirtualArray, *, rate_hz: float) -> str:
    """Return radar.json, which `hil radar` reads back."""
    rx_antennas, seen = range(1, len(array.rx_positions_m) + 1), array.seen(chirp)
    rows = power_of_two_from(seen.chirps)
    config: dict[str, Any] = {
        **device_config(chirp, rx_antennas, frame_repetition_s=1.0 / rate_hz),
        "raw": {"dtype": "uint16", "axes": ["receiver", "chirp", "sample"], "unit": "ADC count"},
        "range_doppler": {
            "dtype": "float32",
            "axes": ["speed", "range"],
            "unit": "ADC count squared",
            "range_step_m": chirp.range_resolution_m * (chirp.samples / power_of_two_from(chirp.samples)),
            "speed_step_mps": seen.speed_resolution_mps * (seen.chirps / rows),
            "zero_speed_row": rows // 2,
        },
        "max_range_m": chirp.max_range_m,
        "max_speed_mps": seen.max_speed_mps,
        "wavelength_m": chirp.wavelength_m,
    }
    if chirp.sampling == "complex" or array.transmitters > 1:
        config["sampling"] = chirp.sampling
        config["tx_positions_m"], config["rx_positions_m"] = array.tx_positions_m, array.rx_positions_m
        config["doppler_bands"] = array.doppler_bands
    return json.dumps(config, indent=2) + "\n"
