"""Settings of the processing chain. The defaults suit a person at a few metres and a small 60 GHz radar."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from sim.radar.chirp import Chirp

WindowName = Literal["none", "hann", "hamming", "blackman", "taylor"]
Clutter = Literal["none", "mean", "mti2", "mti3", "background"]
Cells = Annotated[int, Field(ge=0, le=64)]
Padding = Literal[1, 2, 4, 8]
_LOST = {"mti2": 1, "mti3": 2}  # chirps lost by differences
_Positive = Annotated[float, Field(gt=0.0, le=1e6)]


class CfarParameters(StrictModel):
    """Guard and training cells on each side of the cell under test, in Doppler and in range.

    With zero guard and training cells in one dimension, the detector uses the other dimension only. `rank`: rank of the
    training cell that OS takes as the noise, as a share of their number.
    """

    kind: Literal["ca", "os"] = "os"
    false_alarm: Annotated[float, Field(ge=1e-12, le=0.1)] = 1e-5
    guard_doppler: Cells = 2
    guard_range: Cells = 2
    train_doppler: Cells = 6
    train_range: Cells = 4
    rank: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.5

    @model_validator(mode="after")
    def _something_to_train(self) -> CfarParameters:
        if self.train_doppler == 0 and self.train_range == 0:
            raise ValueError("train_doppler and train_range are both 0: no cell to estimate the noise from")
        return self

    def problem_with(self, rows: int, columns: int) -> str:
        """Return why these settings do not fit a map of `rows` by `columns`; "" if they do."""
        if 2 * (self.guard_doppler + self.train_doppler) + 1 > rows:
            return (
                f"cfar: {self.guard_doppler} guard and {self.train_doppler} training cells on each side are more than "
                f"the {rows} Doppler rows of the map"
            )
        if self.train_doppler == 0 and columns < 2 * (self.guard_range + 1):
            return f"cfar: {self.guard_range} guard cells on each side leave none of {columns} range cells"
        return ""


class TrackerParameters(StrictModel):
    """Parameters of the tracker.

    Points within `cluster_*` of one another form a cluster; clusters within `gate_*` of a track belong to the track.
    Angles are direction sines.
    """

    cluster_range_m: _Positive = 0.8
    cluster_speed_mps: _Positive = 0.8
    cluster_sine: _Positive = 0.4
    gate_range_m: _Positive = 1.0
    gate_speed_mps: _Positive = 1.0
    gate_sine: _Positive = 0.5
    birth_speed_mps: Annotated[float, Field(ge=0.0, le=100.0)] = 0.25
    birth_snr_db: Annotated[float, Field(ge=0.0, le=100.0)] = 12.0
    range_sigma_m: _Positive = 0.12
    speed_sigma_mps: _Positive = 0.2
    sine_sigma: _Positive = 0.1
    acceleration_mps2: _Positive = 1.0
    sine_acceleration_ps2: _Positive = 0.5
    confirm_hits: Annotated[int, Field(ge=1, le=100)] = 3
    confirm_frames: Annotated[int, Field(ge=1, le=100)] = 5
    coast_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.5
    pause_s: _Positive = 0.2

    @model_validator(mode="after")
    def _can_be_confirmed(self) -> TrackerParameters:
        if self.confirm_hits > self.confirm_frames:
            raise ValueError(f"confirm_hits {self.confirm_hits} cannot be above confirm_frames {self.confirm_frames}")
        return self


class Processing(StrictModel):
    """Settings of the whole chain. `background_s`: time constant of the background of `clutter: background`."""

    range_window: WindowName = "hann"
    doppler_window: WindowName = "hann"
    range_padding: Padding = 1
    doppler_padding: Padding = 1
    remove_chirp_mean: bool = True
    clutter: Clutter = "mean"
    background_s: Annotated[float, Field(gt=0.0, le=1e5)] = 20.0
    min_range_m: Annotated[float, Field(ge=0.0, le=1e4)] = 0.0
    max_points: Annotated[int, Field(ge=1, le=4096)] = 256
    max_tracks: Annotated[int, Field(ge=1, le=256)] = 32
    cfar: CfarParameters = CfarParameters()
    tracker: TrackerParameters = TrackerParameters()

    def pulses(self, chirp: Chirp) -> int:
        """Return the number of chirps of a frame after clutter removal."""
        return chirp.chirps - _LOST.get(self.clutter, 0)

    def problem_with(self, chirp: Chirp) -> str:
        """Return why frames of `chirp` cannot be processed with these settings; "" if they can."""
        if self.pulses(chirp) < 2:
            return f"clutter {self.clutter!r} leaves fewer than two of {chirp.chirps} chirps"
        rows = power_of_two_from(chirp.chirps) * self.doppler_padding
        columns = power_of_two_from(chirp.samples) * self.range_padding // 2
        return self.cfar.problem_with(rows, columns)


def power_of_two_from(n: int) -> int:
    """Return the smallest power of two that is not below n."""
    return 1 << (n - 1).bit_length()
