"""Lens of AirSim's cinematography calls: the film of Unreal's default camera, 23.76 mm x 13.365 mm."""

from __future__ import annotations

from dataclasses import dataclass

from hil.apps.airsim.rpc.methods import RpcError
from signals._kernel import det_atan2, det_cos, det_sin
from signals.units import DEG_PER_RAD, RAD_PER_DEG

_LEAST_MM, _MOST_MM = 0.1, 1000.0


@dataclass
class Lens:
    """Lens of one camera. Focus and aperture are kept for clients that read them back."""

    film_width_mm: float = 23.76
    film_height_mm: float = 13.365
    focus_cm: float = 100_000.0
    aperture: float = 2.8
    manual_focus: bool = False
    focus_plane: bool = False

    def set_film(self, width_mm: float, height_mm: float) -> None:
        """Set the size of the film. Raises RpcError."""
        for size in (width_mm, height_mm):
            if not _LEAST_MM <= size <= _MOST_MM:
                raise RpcError(f"a side of the film must be {_LEAST_MM:g} to {_MOST_MM:g} mm, not {size:g}")
        self.film_width_mm, self.film_height_mm = width_mm, height_mm

    def focal_length_mm(self, fov_deg: float) -> float:
        """Return the focal length of a horizontal field of view."""
        half = 0.5 * fov_deg * RAD_PER_DEG
        return 0.5 * self.film_width_mm * det_cos(half) / det_sin(half)

    def fov_deg(self, focal_length_mm: float) -> float:
        """Return the horizontal field of view of a focal length. Raises RpcError."""
        if not _LEAST_MM <= focal_length_mm <= 100.0 * _MOST_MM:
            raise RpcError(
                f"the focal length must be {_LEAST_MM:g} to {100.0 * _MOST_MM:g} mm, not {focal_length_mm:g}"
            )
        return 2.0 * det_atan2(0.5 * self.film_width_mm, focal_length_mm) * DEG_PER_RAD

    def film(self) -> str:
        """Return the film as AirSim describes it."""
        return f"Sensor Width: {self.film_width_mm:f} Sensor Height: {self.film_height_mm:f}"

    def settings(self, fov_deg: float) -> str:
        """Return the lens as AirSim describes it."""
        return f"Focal Length: {self.focal_length_mm(fov_deg):f} F-stop: {self.aperture:f}"

    def field_of_view(self, fov_deg: float) -> str:
        """Return the fields of view, which follow from the film."""
        f = self.focal_length_mm(fov_deg)
        vertical = 2.0 * det_atan2(0.5 * self.film_height_mm, f) * DEG_PER_RAD
        return f"Current Field Of View:\n\tHorizontal: {fov_deg:f},\n\tVertical: {vertical:f}"
