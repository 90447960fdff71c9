"""`hil radar --dca1000 FILE`: the frames as a DCA1000 stores them, with mmWave Studio's settings beside them.

FILE gets the samples, `<FILE without .bin>.mmwave.json` and `.setup.json` the settings (sim/radar/dca1000.py).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signals.errors import ConfigError
from signals.time import NS_PER_S
from sim.radar.dca1000 import frame_words, mmwave_json, setup_json
from sim.sensors.radar_parameters import RadarParameters

_DEFAULT_PERIOD_S = 0.1  # of a recording with one frame


class Dca1000File:
    """Capture file that grows frame by frame; its settings are written at the end. A context manager."""

    def __init__(self, path: Path, p: RadarParameters, part: str) -> None:
        """Raises ConfigError for a radar that a DCA1000 cannot capture."""
        if p.board is None:
            problem = "writes what a TI radar sends, and this radar has no `board` section with its ramp and lanes"
            raise ConfigError.at("--dca1000", problem, "--preset awr1843boost, or another preset of a TI board")
        if path.suffix != ".bin":
            raise ConfigError.at("--dca1000", f"{path} has no .bin at its end", f"{path.with_suffix('.bin')}")
        self.path, self._p, self._board, self._part = path, p, p.board, part
        self._times_ns: list[int] = []

    def __enter__(self) -> Dca1000File:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("wb")
        return self

    def add(self, t_ns: int, raw: NDArray[np.uint16]) -> None:
        """Append a frame (channels, chirps, samples)."""
        p = self._p
        self._times_ns.append(t_ns)
        self._file.write(frame_words(raw, p.chirp, self._board, p.receiver.adc_bits).tobytes())

    def __exit__(self, kind: object, *_: object) -> None:
        self._file.close()
        if kind is not None:
            return
        settings, setup = self.settings_files
        p, times = self._p, self._times_ns
        period_s = float(np.median(np.diff(times))) / NS_PER_S if len(times) > 1 else _DEFAULT_PERIOD_S
        settings.write_text(
            mmwave_json(
                p.chirp,
                p.antenna.array,
                self._board,
                rx_gain_db=p.receiver.conversion_gain_db,
                frames=len(times),
                period_s=period_s,
            )
        )
        setup.write_text(setup_json(self._part, self.path.name, settings.name))

    @property
    def settings_files(self) -> tuple[Path, Path]:
        """Paths of the settings of the device and of the capture."""
        return self.path.with_suffix(".mmwave.json"), self.path.with_suffix(".setup.json")
