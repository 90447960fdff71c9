"""Raw frames as TI's DCA1000 capture card stores them, with the settings that mmWave Studio keeps beside them.

Samples are int16, little endian, chirp by chirp in order of time, frames without a gap. Within a chirp (TI SWRA581B,
Mmwave Radar Device ADC Raw Data Capture), receivers k = 0 ... K - 1 and samples n = 0 ... N - 1:

    two LVDS lanes (xWR16xx, xWR18xx, xWR68xx), receiver by receiver
        complex    I[k,0] I[k,1] Q[k,0] Q[k,1] I[k,2] I[k,3] Q[k,2] Q[k,3] ...
        real       x[k,0] x[k,1] x[k,2] ...
    four lanes (xWR12xx, xWR14xx, xWR22xx), sample by sample
        complex    I[0,n] I[1,n] ... I[K-1,n] Q[0,n] Q[1,n] ... Q[K-1,n]
        real       x[0,n] x[1,n] ... x[K-1,n]

The converter's codes become signed: code - 2^(bits - 1).

`NAME.mmwave.json` has the keys of mmWave Studio's export that describe one device, one profile and one chirp for each
transmitter; `NAME.setup.json` names both files, as mmWave Studio's does.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.radar.board import Board
from sim.radar.chirp import Chirp
from sim.radar.virtual_array import VirtualArray

INT16 = np.dtype("<i2")
_REAL, _COMPLEX = 0, 1  # b2AdcOutFmt: real, complex without the image band
_SIXTEEN_BITS = 2  # b2AdcBits
_US, _MHZ_PER_US = 1e6, 1e-12


def frame_words(raw: NDArray[np.uint16], chirp: Chirp, board: Board, adc_bits: int) -> NDArray[np.int16]:
    """Return the words of a frame (channels, chirps, samples), a new array of one dimension.

    Raises ValueError for an odd number of complex samples with two lanes.
    """
    x = (raw.astype(np.int32) - (1 << (adc_bits - 1))).astype(INT16)
    channels, chirps, samples = x.shape
    if chirp.sampling == "real":
        order = (1, 0, 2) if board.lvds_lanes == 2 else (1, 2, 0)
        return np.ascontiguousarray(x.transpose(order)).reshape(-1)
    receivers = channels // 2
    if board.lvds_lanes == 4:
        by_part = x.reshape(receivers, 2, chirps, samples)
        return np.ascontiguousarray(by_part.transpose(2, 3, 1, 0)).reshape(-1)
    if samples % 2:
        raise ValueError(f"two lanes carry pairs of complex samples, not {samples}")
    in_pairs = x.reshape(receivers, 2, chirps, samples // 2, 2)
    return np.ascontiguousarray(in_pairs.transpose(2, 0, 3, 1, 4)).reshape(-1)


def mmwave_json(
    chirp: Chirp, array: VirtualArray, board: Board, *, rx_gain_db: float, frames: int, period_s: float
) -> str:
    """Return the settings of the device in mmWave Studio's terms."""
    transmitters, turns = array.transmitters, array.turns
    lanes = {2: "0x3", 4: "0xF"}[board.lvds_lanes]
    profile = {
        "profileId": 0,
        "pfVcoSelect": "0x0" if board.band_hz[0] < 70e9 else "0x2",
        "startFreqConst_GHz": round(board.ramp_start_hz(chirp) * 1e-9, 9),
        "idleTimeConst_usec": round(board.idle_s(chirp) * _US, 6),
        "adcStartTimeConst_usec": round(board.adc_start_s * _US, 6),
        "rampEndTime_usec": round(board.ramp_s(chirp) * _US, 6),
        "txOutPowerBackoffCode": "0x0",
        "txPhaseShifter": "0x0",
        "freqSlopeConst_MHz_usec": round(chirp.slope_hz_per_s * _MHZ_PER_US, 9),
        "txStartTime_usec": 0.0,
        "numAdcSamples": chirp.samples,
        "digOutSampleRate": round(chirp.sample_rate_hz * 1e-3, 6),
        "hpfCornerFreq1": 0,
        "hpfCornerFreq2": 0,
        "rxGain_dB": f"0x{round(rx_gain_db):X}",
    }
    chirps = [
        {
            "rlChirpCfg_t": {
                "chirpStartIdx": turn,
                "chirpEndIdx": turn,
                "profileId": 0,
                "startFreqVar_MHz": 0.0,
                "freqSlopeVar_KHz_usec": 0.0,
                "idleTimeVar_usec": 0.0,
                "adcStartTimeVar_usec": 0.0,
                "txEnable": f"0x{board.tx_mask(turn, transmitters, turns):X}",
            }
        }
        for turn in range(turns)
    ]
    device: dict[str, Any] = {
        "mmWaveDeviceId": 0,
        "rfConfig": {
            "waveformType": "legacyFrameChirp",
            "MIMOScheme": "TDM" if not array.doppler_bands else "DDM",
            "rlChanCfg_t": {
                "rxChannelEn": f"0x{(1 << len(array.rx_positions_m)) - 1:X}",
                "txChannelEn": f"0x{board.tx_mask(0, transmitters, 1):X}",
                "cascading": 0,
                "cascadingPinoutCfg": "0x0",
            },
            "rlAdcOutCfg_t": {
                "fmt": {
                    "b2AdcBits": _SIXTEEN_BITS,
                    "b8FullScaleReducFctr": 0,
                    "b2AdcOutFmt": _COMPLEX if chirp.sampling == "complex" else _REAL,
                }
            },
            "rlLowPowerModeCfg_t": {"lpAdcMode": 0},
            "rlProfiles": [{"rlProfileCfg_t": profile}],
            "rlChirps": chirps,
            "rlFrameCfg_t": {
                "chirpEndIdx": turns - 1,
                "chirpStartIdx": 0,
                "numLoops": chirp.chirps // turns,
                "numFrames": frames,
                "numAdcSamples": chirp.samples * chirp.parts,
                "frameTriggerDelay": 0.0,
                "framePeriodicity_msec": round(period_s * 1e3, 6),
            },
            "rlBpmChirps": [],
        },
        "rawDataCaptureConfig": {
            "rlDevDataFmtCfg_t": {"iqSwapSel": 0, "chInterleave": 1 if board.lvds_lanes == 2 else 0},
            "rlDevDataPathCfg_t": {
                "intfSel": 1,
                "transferFmtPkt0": "0x1",
                "transferFmtPkt1": "0x0",
                "cqConfig": 2,
                "cq0TransSize": 64,
                "cq1TransSize": 64,
                "cq2TransSize": 64,
            },
            "rlDevDataPathClkCfg_t": {"laneClkCfg": 1, "dataRate": 1},
            "rlDevLaneEnable_t": {"laneEn": lanes},
            "rlDevLvdsLaneCfg_t": {"laneFmtMap": 0, "laneParamCfg": "0x1"},
        },
        "monitoringConfig": {},
    }
    content = {
        "configGenerator": {"createdBy": "hil radar", "createdOn": "", "isConfigIntermediate": 0},
        "currentVersion": {"jsonCfgVersion": {"major": 0, "minor": 4, "patch": 0}},
        "systemConfig": {"summary": "", "sceneParameters": {}},
        "mmWaveDevices": [device],
    }
    return json.dumps(content, indent=2) + "\n"


def setup_json(part: str, binary: str, settings: str) -> str:
    """Return the file that names the capture `binary` and its `settings`, both by their names in the same folder."""
    content = {
        "createdByVersion": "hil radar",
        "createdOn": "",
        "configUsed": settings,
        "captureHardware": "DCA1000",
        "mmWaveDevice": part,
        "operatingFreq": "",
        "DCA1000Config": {
            "dataLoggingMode": "raw",
            "dataTransferMode": "LVDSCapture",
            "dataCaptureMode": "ethernetStream",
            "dataFormatMode": 3,
            "packetDelay_us": 25,
            "ethernetConfig": {
                "DCA1000IPAddress": "192.168.33.180",
                "DCA1000ConfigPort": 4096,
                "DCA1000DataPort": 4098,
            },
        },
        "capturedFiles": {
            "numFilesCollected": 1,
            "fileBasePath": ".",
            "files": [{"rawFileName": binary, "processedFileName": binary}],
        },
    }
    return json.dumps(content, indent=2) + "\n"
