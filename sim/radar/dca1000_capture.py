"""Captures of a DCA1000: mmWave Studio's settings of the device, and the samples as raw frames.

The order of the samples is that of dca1000.py, which writes them. The settings are a `.mmwave.json` with one device,
one profile and legacy frames; of it are read

    rfConfig.rlChanCfg_t                        rxChannelEn, a mask
    rfConfig.rlAdcOutCfg_t.fmt                  b2AdcBits (0, 1, 2: 12, 14, 16 bits), b2AdcOutFmt (0 real, 1 complex,
                                                2 complex with the image band)
    rfConfig.rlProfiles, rlChirps, rlFrameCfg_t the ramp; transmitters, loops, frames and their period
    rawDataCaptureConfig                        iqSwapSel (1: quadrature first), chInterleave (0: sample by sample),
                                                transferFmtPkt0 (1: samples alone), laneEn, a mask

A number may also be a string, as "0xF" in mmWave Studio's own files. What decides the order of the samples has no
default; what a single-chip capture cannot have otherwise (iqSwapSel, transferFmtPkt0, chInterleave) may be left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray

from signals.errors import ConfigError, Problem
from sim.radar.chirp import Chirp
from sim.radar.dca1000 import INT16

_BITS = {0: 12, 1: 14, 2: 16}
_SAMPLING = {0: "real", 1: "complex", 2: "complex"}
_PSEUDO_REAL = 3
_SAMPLES_ALONE = 1


@dataclass(frozen=True)
class CaptureSettings:
    """Settings of a capture: what its samples are."""

    chirp: Chirp  # of all transmitters
    receivers: tuple[int, ...]  # numbers of those that are on, from 1
    transmitters: tuple[tuple[int, ...], ...]  # numbers of those of each chirp of a loop
    lanes: int
    adc_bits: int
    quadrature_first: bool
    adc_start_s: float
    excess_s: float  # of the ramp after the last sample
    frames: int  # 0: until it was stopped
    period_s: float

    @property
    def channels(self) -> int:
        return len(self.receivers) * self.chirp.parts

    @property
    def frame_bytes(self) -> int:
        """Size of a frame in the file."""
        return INT16.itemsize * self.channels * self.chirp.chirps * self.chirp.samples


class _Reader:
    """Reads values by path and collects what is wrong with them."""

    def __init__(self, where: str) -> None:
        self._where = where
        self.problems: list[Problem] = []

    def say(self, message: str, hint: str = "") -> None:
        self.problems.append(Problem(self._where, message, hint))

    def section(self, outer: Any, key: str, path: str) -> Mapping[str, Any]:
        value = outer.get(key) if isinstance(outer, Mapping) else None
        if isinstance(value, Mapping):
            return value
        self.say(f"has no section {path}")
        return {}

    def rows(self, outer: Any, key: str, path: str) -> list[Any]:
        value = outer.get(key) if isinstance(outer, Mapping) else None
        if isinstance(value, list) and value:
            return value
        self.say(f"has no list {path}")
        return []

    def number(
        self, section: Mapping[str, Any], key: str, *, least: float = 0.0, default: float | None = None
    ) -> float | None:
        """Return a number, from a string too; None, with a problem, where there is none."""
        if not section:
            return default  # its absence is a problem already
        value = section.get(key)
        if value is None and default is not None:
            return default
        found: float | None = None
        if isinstance(value, str):
            try:
                found = float(int(value, 0))
            except ValueError:
                try:
                    found = float(value)
                except ValueError:
                    found = None
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found = float(value)
        if found is None or not least <= found <= 1e15:
            told = f"is {value!r:.40}, not a number" if key in section else "is missing"
            self.say(f"{key} {told}" + (f" of {least:g} or more" if found is not None else ""))
            return None
        return found

    def whole(self, section: Mapping[str, Any], key: str, *, least: int = 0, default: int | None = None) -> int | None:
        value = self.number(section, key, least=least, default=default)
        if value is not None and value != int(value):
            self.say(f"{key} is {value:g}, not a whole number")
            return None
        return None if value is None else int(value)


def capture_settings(content: Any, where: str, *, lanes: int | None = None) -> CaptureSettings:
    """Return the settings in a parsed `.mmwave.json`. `lanes`: of the device, where the file does not tell.

    Raises ConfigError with every problem found.
    """
    read = _Reader(where)
    devices = read.rows(content, "mmWaveDevices", "mmWaveDevices")
    if len(devices) > 1:
        read.say(f"is of {len(devices)} devices in a cascade", "a DCA1000 captures one; their files have another order")
    device = devices[0] if devices and isinstance(devices[0], Mapping) else {}
    rf = read.section(device, "rfConfig", "mmWaveDevices.rfConfig") if devices else {}
    if not rf:
        raise ConfigError(read.problems)
    kind = rf.get("waveformType", "legacyFrameChirp")
    if kind != "legacyFrameChirp":
        read.say(f"waveformType is {kind!r}", "legacyFrameChirp is read: one profile, the same chirps in each loop")
    receivers = _numbers(read.whole(read.section(rf, "rlChanCfg_t", "rlChanCfg_t"), "rxChannelEn", least=1))
    sampling, adc_bits = _format(read, rf)
    profile = _profile(read, rf)
    frame = read.section(rf, "rlFrameCfg_t", "rlFrameCfg_t")
    transmitters = _transmitters(read, rf, frame)
    loops = read.whole(frame, "numLoops", least=1)
    frames = read.whole(frame, "numFrames")
    period_ms = read.number(frame, "framePeriodicity_msec")
    lane_count, quadrature_first = _order(read, device, lanes)
    ramp = {
        key: read.number(profile, key)
        for key in (
            "startFreqConst_GHz", "freqSlopeConst_MHz_usec", "digOutSampleRate", "numAdcSamples",
            "idleTimeConst_usec", "adcStartTimeConst_usec", "rampEndTime_usec",
        )
    }  # fmt: skip
    if read.problems or loops is None or frames is None or period_ms is None or lane_count is None:
        raise ConfigError(read.problems)
    start, slope, rate, samples, idle, adc_start, ramp_end = (float(value or 0.0) for value in ramp.values())
    slope_hz_per_s, rate_hz = slope * 1e12, rate * 1e3
    sampling_s = samples / rate_hz if rate_hz else 0.0
    excess_s = 1e-6 * (ramp_end - adc_start) - sampling_s
    if excess_s < -1e-9:
        end_us = adc_start + 1e6 * sampling_s
        read.say(f"rampEndTime_usec is {ramp_end:g}, and the last sample is at {end_us:g} us", "is it of this capture?")
        raise ConfigError(read.problems)
    bandwidth_hz = slope_hz_per_s * sampling_s
    turns = len(transmitters)
    try:
        chirp = Chirp(
            center_frequency_hz=start * 1e9 + slope_hz_per_s * 1e-6 * adc_start + 0.5 * bandwidth_hz,
            bandwidth_hz=bandwidth_hz,
            samples=int(samples),
            sample_rate_hz=rate_hz,
            chirps=loops * turns,
            repetition_s=1e-6 * (idle + ramp_end),
            sampling=sampling,
        )
    except pydantic.ValidationError as error:
        for item in error.errors():
            name = ".".join(str(part) for part in item["loc"]) or "its chirp"
            read.say(f"{name} is not possible: {item['msg']}")
        raise ConfigError(read.problems) from error
    if chirp.sampling == "complex" and lane_count == 2 and chirp.samples % 2:
        read.say(f"numAdcSamples is {chirp.samples}", "two lanes carry pairs of complex samples")
    if 0.0 < period_ms * 1e-3 < (chirp.chirps - 1) * chirp.repetition_s + chirp.sampling_s:
        read.say(f"framePeriodicity_msec is {period_ms:g}, less than the {1e3 * chirp.frame_s:.6g} of a frame's chirps")
    if read.problems:
        raise ConfigError(read.problems)
    return CaptureSettings(
        chirp, receivers, transmitters, lane_count, adc_bits, quadrature_first, 1e-6 * adc_start, max(excess_s, 0.0),
        frames, 1e-3 * period_ms if period_ms > 0.0 else chirp.frame_s,
    )  # fmt: skip


def _numbers(mask: int | None) -> tuple[int, ...]:
    """Return the numbers of the set bits, from 1."""
    return () if mask is None else tuple(bit + 1 for bit in range(12) if mask >> bit & 1)


def _format(read: _Reader, rf: Mapping[str, Any]) -> tuple[Any, int]:
    fmt = read.section(read.section(rf, "rlAdcOutCfg_t", "rlAdcOutCfg_t"), "fmt", "rlAdcOutCfg_t.fmt")
    bits, form = read.whole(fmt, "b2AdcBits"), read.whole(fmt, "b2AdcOutFmt")
    if bits is not None and bits not in _BITS:
        read.say(f"b2AdcBits is {bits}, not 0, 1 or 2")
    if form == _PSEUDO_REAL:
        read.say("b2AdcOutFmt is 3, pseudo-real samples", "real (0) and complex ones (1, 2) are read")
    elif form is not None and form not in _SAMPLING:
        read.say(f"b2AdcOutFmt is {form}, not 0, 1 or 2")
    return _SAMPLING.get(form or 0, "real"), _BITS.get(2 if bits is None else bits, 16)


def _profile(read: _Reader, rf: Mapping[str, Any]) -> Mapping[str, Any]:
    profiles = read.rows(rf, "rlProfiles", "rlProfiles")
    if len(profiles) > 1:
        read.say(f"has {len(profiles)} profiles", "captures with one are read")
    return read.section(profiles[0], "rlProfileCfg_t", "rlProfiles.rlProfileCfg_t") if profiles else {}


def _transmitters(read: _Reader, rf: Mapping[str, Any], frame: Mapping[str, Any]) -> tuple[tuple[int, ...], ...]:
    """Return the transmitters of each chirp of a loop."""
    first, last = read.whole(frame, "chirpStartIdx"), read.whole(frame, "chirpEndIdx")
    masks: dict[int, int] = {}
    for row in read.rows(rf, "rlChirps", "rlChirps"):
        chirp = read.section(row, "rlChirpCfg_t", "rlChirps.rlChirpCfg_t")
        begin, end = read.whole(chirp, "chirpStartIdx"), read.whole(chirp, "chirpEndIdx")
        mask = read.whole(chirp, "txEnable")
        for key in ("startFreqVar_MHz", "freqSlopeVar_KHz_usec", "idleTimeVar_usec", "adcStartTimeVar_usec"):
            if read.number(chirp, key, least=-1e15, default=0.0):
                read.say(f"{key} differs from chirp to chirp", "captures of equal chirps are read")
        if begin is not None and end is not None and mask is not None and end - begin < 512:
            masks |= dict.fromkeys(range(begin, end + 1), mask)
    if first is None or last is None or not masks:
        return ()
    if last < first or last - first >= 512:
        read.say(f"chirpStartIdx {first} to chirpEndIdx {last} is no loop of chirps")
        return ()
    missing = [index for index in range(first, last + 1) if index not in masks]
    if missing:
        read.say(f"a loop has chirps {first} to {last}, and rlChirps does not define {missing[0]}")
        return ()
    loop = tuple(_numbers(masks[index]) for index in range(first, last + 1))
    if () in loop:
        read.say(f"txEnable of chirp {first + loop.index(())} is 0: nothing transmits")
    return loop


def _order(read: _Reader, device: Mapping[str, Any], lanes: int | None) -> tuple[int | None, bool]:
    """Return the number of lanes, and whether quadrature samples come first."""
    capture = read.section(device, "rawDataCaptureConfig", "mmWaveDevices.rawDataCaptureConfig")
    found = capture.get("rlDevLaneEnable_t")
    if isinstance(found, Mapping):
        mask = read.whole(found, "laneEn", least=1)
        lanes = None if mask is None else mask.bit_count()
    elif lanes is None and capture:
        read.say("has no rlDevLaneEnable_t, so that the order of its samples is not known", "laneEn: 0x3 or 0xF")
    if lanes is not None and lanes not in (2, 4):
        read.say(f"laneEn has {lanes} LVDS lanes", "captures of two (0x3) or four (0xF) are read")
    form = capture.get("rlDevDataFmtCfg_t", {})
    form = form if isinstance(form, Mapping) else {}
    interleave = read.whole(form, "chInterleave", default=-1)
    if lanes in (2, 4) and interleave not in (-1, None, 1 if lanes == 2 else 0):
        read.say(
            f"chInterleave is {interleave} with {lanes} lanes",
            "two lanes carry receiver by receiver (1), four lanes sample by sample (0)",
        )
    path = capture.get("rlDevDataPathCfg_t", {})
    path = path if isinstance(path, Mapping) else {}
    packet = read.whole(path, "transferFmtPkt0", default=_SAMPLES_ALONE)
    if packet not in (None, _SAMPLES_ALONE):
        read.say(f"transferFmtPkt0 is {packet:#x}: not samples alone", "captures with 0x1 are read")
    swap = read.whole(form, "iqSwapSel", default=0)
    return lanes, swap == 1


def raw_frame(words: NDArray[np.int16], settings: CaptureSettings) -> NDArray[np.uint16]:
    """Return a frame's words as codes of the converter, (channels, chirps, samples): the inverse of `frame_words`.

    Raises ValueError for a word that is no code of the converter.
    """
    chirp, receivers = settings.chirp, len(settings.receivers)
    if chirp.sampling == "real":
        if settings.lanes == 2:
            x = words.reshape(chirp.chirps, receivers, chirp.samples).transpose(1, 0, 2)
        else:
            x = words.reshape(chirp.chirps, chirp.samples, receivers).transpose(2, 0, 1)
    elif settings.lanes == 4:
        by_part = words.reshape(chirp.chirps, chirp.samples, 2, receivers).transpose(3, 2, 0, 1)
        x = (by_part[:, ::-1] if settings.quadrature_first else by_part).reshape(settings.channels, *by_part.shape[2:])
    else:
        in_pairs = words.reshape(chirp.chirps, receivers, chirp.samples // 2, 2, 2).transpose(1, 3, 0, 2, 4)
        by_part = in_pairs[:, ::-1] if settings.quadrature_first else in_pairs
        x = by_part.reshape(settings.channels, chirp.chirps, chirp.samples)
    half = 1 << (settings.adc_bits - 1)
    codes = x.astype(np.int32) + half
    if settings.adc_bits < 16 and not (codes.min() >= 0 and codes.max() < 2 * half):
        raise ValueError(f"a sample of {int(x.min())} to {int(x.max())} is no code of {settings.adc_bits} bits")
    return codes.astype(np.uint16)
