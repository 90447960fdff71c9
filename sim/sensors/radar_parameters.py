"""Parameters of a radar, as in a bench file or a preset."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from signals.documents.validate import StrictModel
from signals.samples import RADAR_UNITS
from sim.frame.camera_model import CameraModel
from sim.frame.shared_picture import SharedPicture
from sim.radar.antenna import Antenna
from sim.radar.board import Board
from sim.radar.bounces import Bounces
from sim.radar.chirp import Chirp
from sim.radar.impairments import Impairments
from sim.radar.interference import Interference
from sim.radar.mask import Mask
from sim.radar.processing.parameters import Processing, power_of_two_from
from sim.radar.receiver import Receiver
from sim.radar.synthesis import MAX_TOLERANCE, MIN_TOLERANCE
from sim.sensors.camera_parameters import Pixels
from sim.sensors.sensor import Attitude, Position, check_order

_RESOLUTION = (320, 240)
_FOV_DEG = 90.0
_NEAR_M, _FAR_M = 0.05, 10_000.0
_ZERO = (0.0, 0.0, 0.0)
# Keys of the radar's own view; not with `frame`, where a camera gives the view.
VIEW_KEYS = ("resolution", "fov_deg", "mount_m", "mount_rpy_deg", "near_m", "far_m")


class RadarParameters(StrictModel):
    """Parameters of one radar: chirps, hardware, view and processing."""

    chirp: Chirp
    antenna: Antenna
    receiver: Receiver
    impairments: Impairments = Impairments()
    mask: Mask = Mask()
    rain_mm_per_h: Annotated[float, Field(ge=0.0, le=200.0)] | None = None  # null: of the scene's weather; 0: none
    interference: Interference | None = None  # with radars of other vehicles; null: none
    bounces: Bounces | None = None  # paths by mirrors; null: none
    processing: Processing = Processing()
    # Name of a camera whose pictures, mount and lens the radar uses. Null: its own view, given by the next six keys.
    frame: str | None = None
    resolution: tuple[Pixels, Pixels] | None = None  # width, height; null: 320 x 240
    fov_deg: Annotated[float, Field(gt=0.0, lt=180.0)] | None = None  # horizontal; null: 90
    mount_m: Position | None = None  # from the body origin, in B; null: at the origin
    mount_rpy_deg: Attitude | None = None  # null: looks forward; sim/frame/mount.py
    near_m: Annotated[float, Field(gt=0.0, le=100.0)] | None = None  # null: 0.05
    far_m: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None  # null: 10 000
    method: Literal["nufft", "direct"] = "nufft"  # direct: the exact sum, which is slow
    tolerance: Annotated[float, Field(ge=MIN_TOLERANCE, le=MAX_TOLERANCE)] = 1e-3  # of nufft, relative to the frame
    outputs: tuple[str, ...] = tuple(RADAR_UNITS)
    latency_s: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0  # from the end of the frame
    board: Board | None = None  # limits of the device; null: none are checked

    @field_validator("outputs")
    @classmethod
    def _known_outputs(cls, outputs: tuple[str, ...]) -> tuple[str, ...]:
        if not outputs:
            raise ValueError("must name at least one output")
        for output in outputs:
            if output not in RADAR_UNITS:
                raise ValueError(f"there is no output {output!r}; outputs: {', '.join(RADAR_UNITS)}")
        if len(set(outputs)) < len(outputs):
            raise ValueError("an output is named twice")
        return outputs

    @model_validator(mode="after")
    def _consistent(self) -> RadarParameters:
        given = [key for key in VIEW_KEYS if getattr(self, key) is not None]
        if self.frame is not None and given:
            raise ValueError(f"frame {self.frame!r} already gives the radar's view: leave out {', '.join(given)}")
        problems = [f"chirp.{problem}" for problem in self.board.problems_with(self.chirp)] if self.board else []
        problems += self.antenna.problems_with(self.chirp)
        if problems:
            raise ValueError("; ".join(problems))
        unfit = self.impairments.problems_with(self.chirp, self.antenna.channels(self.chirp))
        if unfit:
            raise ValueError("impairments." + "; impairments.".join(unfit))
        unfit_processing = self.processing.problem_with(self.seen) if self.needs_processing else ""
        if unfit_processing:
            raise ValueError(f"processing.{unfit_processing}; or set outputs: [raw], which needs no processing")
        near_m, far_m = self.limits_m
        check_order(("near_m", near_m), ("far_m", far_m))
        if self.frame is None:
            self.view()  # raises ValueError for an impossible lens
        return self

    @property
    def limits_m(self) -> tuple[float, float]:
        """Minimum and maximum visible depth."""
        return _NEAR_M if self.near_m is None else self.near_m, _FAR_M if self.far_m is None else self.far_m

    @property
    def seen(self) -> Chirp:
        """The frame as each channel of the virtual array sees it: its speeds are the map's."""
        return self.antenna.array.seen(self.chirp)

    @property
    def raw_shape(self) -> tuple[int, int, int]:
        """Shape of a raw frame: channels, chirps, samples."""
        return self.antenna.channels(self.chirp), self.chirp.chirps, self.chirp.samples

    @property
    def map_shape(self) -> tuple[int, int]:
        """Shape of a range-Doppler map: speeds, ranges."""
        seen, p = self.seen, self.processing
        rows = power_of_two_from(seen.chirps) * p.doppler_padding
        return rows, power_of_two_from(seen.samples) * p.range_padding * seen.parts // 2

    @property
    def needs_processing(self) -> bool:
        """True if any output needs processing."""
        return self.outputs != ("raw",)

    def view(self) -> SharedPicture:
        """Return the view of a radar without `frame`."""
        width, height = self.resolution or _RESOLUTION
        near_m, far_m = self.limits_m
        return SharedPicture(
            CameraModel.from_fov(width, height, _FOV_DEG if self.fov_deg is None else self.fov_deg),
            mount_m=_ZERO if self.mount_m is None else self.mount_m,
            mount_rpy_deg=_ZERO if self.mount_rpy_deg is None else self.mount_rpy_deg,
            near_m=near_m,
            far_m=far_m,
        )
