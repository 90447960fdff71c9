"""`hil calibrate`: fits a sensor preset to a recording of the user's own sensor."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hil.run.report.run_folder import locked_folder
from signals.errors import ConfigError, file_errors
from sim.radar.calibration import Calibration, Fitted, calibrate
from sim.radar.preset_text import Hardware, hardware_of, preset_text, with_receivers
from sim.radar.recording import Recording, load_recording
from sim.sensors.presets import PRESET_DIR

_CHIP = "bgt60tr13c"  # its antennas and receiver are assumed, because a recording does not contain them


@dataclass(frozen=True)
class CalibratedFiles:
    """Files that a calibration has written."""

    preset: Path
    picture: Path


def calibrate_radar(
    recording_file: Path,
    console: Console,
    *,
    frames: str | None = None,
    out: Path | None = None,
    name: str | None = None,
    keep_echoes: bool = False,
) -> CalibratedFiles:
    """Fit a radar's preset to a recording, print the fitted values, and write preset and picture.

    `frames` is a range FIRST:END of the recording's frames, `name` the preset's name in a bench file; `keep_echoes`
    does not remove the reflectors of the recorded scene from the fixed leakage pattern. Raises ConfigError,
    RecordingError.
    """
    frame_range = _frames(frames)
    preset_name = _name(name if name is not None else recording_file.stem, given=name is not None)
    preset = out if out is not None else Path(f"{preset_name}.yaml")
    if preset.suffix not in (".yaml", ".yml"):
        raise ConfigError.at("--out", f"must name a YAML file, not {preset.name!r}")
    recording = load_recording(recording_file)
    hardware = with_receivers(hardware_of(PRESET_DIR / f"{_CHIP}.yaml"), recording.rx_antennas)
    if hardware is None:
        numbers = ", ".join(str(a) for a in recording.rx_antennas)
        message = f"uses the receivers {numbers}, not all of which {_CHIP} has"
        raise ConfigError.at(str(recording_file), message, "see rx_antennas in the recording's settings")
    files = CalibratedFiles(preset, preset.with_suffix(".png"))
    with locked_folder(preset.parent):
        calibration = calibrate(recording, frames=frame_range, keep_echoes=keep_echoes, where=str(recording_file))
        _write(files, calibration, recording, hardware, preset_name=preset_name, source=recording_file.name)
    _print(console, calibration, recording)
    return files


def _write(
    files: CalibratedFiles,
    calibration: Calibration,
    recording: Recording,
    hardware: Hardware,
    *,
    preset_name: str,
    source: str,
) -> None:
    from hil.apps.calibrate.picture import draw_calibration  # imported late: matplotlib takes half a second

    text = preset_text(calibration, recording, hardware, part=preset_name, source=source)
    with file_errors(files.preset):
        temporary = files.preset.with_suffix(".tmp")
        temporary.write_text(text, encoding="utf-8")  # a full disk must not destroy an existing preset
        os.replace(temporary, files.preset)
        draw_calibration(calibration, recording, files.picture)


def _frames(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,9}):(\d{1,9})", text.strip())
    if match is None:
        raise ConfigError.at("--frames", f"must be FIRST:END, such as 0:64, not {text!r}")
    return int(match[1]), int(match[2])


def _name(text: str, *, given: bool) -> str:
    """Return the preset's name for bench files: `text` itself, or a name made from a file's name."""
    if re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}", text):
        return text
    if given:
        raise ConfigError.at("--name", f"must be letters, digits, '_', '.' or '-', not {text!r}")
    return re.sub(r"[^A-Za-z0-9_]+", "_", text)[:80].strip("_") or "radar"


def _print(console: Console, calibration: Calibration, recording: Recording) -> None:
    first, last = calibration.frames
    receivers = [f"RX{a}" for a in recording.rx_antennas]
    table = Table(f"frames {first} to {last - 1}, +- 1 sigma", box=None, padding=(0, 2, 0, 0))
    for receiver in receivers:
        table.add_column(receiver, justify="right", no_wrap=True)
    for row in calibration.rows:
        cells = _cells(row)
        cells += [""] * (len(receivers) - len(cells))
        table.add_row(f"{row.name} [{row.unit}]" if row.unit else row.name, *cells)
    console.print(table)
    for echo in calibration.echoes:
        amplitudes = ", ".join(f"{a:.1f}" for a in echo.amplitude)
        console.print(f"reflector at {echo.range_m:.3f} m, {echo.snr_db:.0f} dB over the noise: {amplitudes} counts")
    for warning in calibration.warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}", markup=True)


def _cells(row: Fitted) -> list[str]:
    return [_with_error(value, sigma) for value, sigma in zip(row.value, row.sigma, strict=True)]


def _with_error(value: float, sigma: float) -> str:
    """Return a value as text, rounded at the first significant digit of its standard deviation."""
    if not sigma > 0.0:
        return f"{value:.4g}"
    digits = min(max(-_exponent(sigma), 0), 5)
    return f"{value:.{digits}f} +-{sigma:.{digits}f}"


def _exponent(x: float) -> int:
    return int(f"{x:e}".split("e")[1])
