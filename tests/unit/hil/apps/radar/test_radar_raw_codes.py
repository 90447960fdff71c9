"""`hil radar` tells of raw codes that show nothing: its maps and tracks looked like any others."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from rich.console import Console

from hil.apps.radar.command import Outputs, process_radar
from hil.apps.radar.raw_codes import RawCodes
from sim.radar.recording import save_recording
from tests.worlds.radar_recordings import recording_of


def test_clipped_and_constant_codes_are_told() -> None:
    codes = RawCodes(adc_bits=12)
    frame = np.full((2, 10, 10), 2048, np.uint16)
    codes.add(frame)
    assert codes.warnings() == [
        "channel 1 has one code only in 1 frame: it is not connected",
        "channel 2 has one code only in 1 frame: it is not connected",
    ]
    codes.add(frame + np.array([0, 1], np.uint16)[:, None, None])
    assert codes.warnings() == ["channel 1 has one code only in 2 frames: it is not connected"]
    frame[0, 0, :2] = 0, 4095
    frame[0, 1, :3] = 4095, 4094, 0
    codes.add(frame)  # 4 of 600
    assert codes.warnings() == []
    frame[1, :, 0] = 4095
    codes.add(frame)  # 18 of 800
    (told,) = codes.warnings()
    assert told == "the converter clipped 2% of the samples, so that ranges and speeds are false"


def test_the_command_says_so(tmp_path: Path) -> None:
    noise = np.random.Generator(np.random.Philox(1)).normal(0.0, 5.0, (4, 3, 64, 64))
    for name, gain, told in (("whole", 1.0, False), ("loud", 400.0, True)):
        adc = np.clip(np.rint(2048.0 + gain * noise), 0, 4095).astype(np.uint16)
        save_recording(tmp_path / f"{name}.npz", recording_of(adc))
        said = Console(file=io.StringIO(), width=200)
        process_radar(tmp_path / f"{name}.npz", said, outputs=Outputs(tmp_path / name), quiet=True)
        assert ("clipped" in said.file.getvalue()) == told  # type: ignore[attr-defined]
