"""Virtual array of a radar: one channel for each pair of a transmitter and a receiver, at t_p + r_k.

In time division, transmitter p of P sends every P-th chirp, delta_p = (p - (P - 1) / 2) / P of its own repetition time
off the middle of all. So an echo that turns by a cycles from one of a transmitter's chirps to its next has the
additional phase a delta_p in that transmitter's channels, which has to be taken out before angles are found.

In Doppler division with D bands, transmitter p adds p m / D cycles to chirp m. Either way a channel tells speeds apart
as a radar with one transmitter and D or P times the repetition time does: `seen`.

A direction is ambiguous if another one has the same phases in all channels. With b the shortest bases between channels
that span the array, and azimuth and elevation within +-A and +-E of the axis, phases do not fold as long as

    |b_y| sin A + |b_z| sin E <= lambda / 2
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import sqrt

from signals._kernel import det_asin, det_sin
from signals.rotation import minus
from signals.samples import Vec3
from signals.units import RAD_PER_DEG
from sim.radar.chirp import Chirp

_SLACK = 1.0 + 1e-6
_SAME_PLACE = 1e-3  # of a wavelength


@dataclass(frozen=True)
class VirtualArray:
    """Places in R [m]. `doppler_bands` 0: the transmitters take turns; otherwise all transmit in every chirp."""

    rx_positions_m: tuple[Vec3, ...]
    tx_positions_m: tuple[Vec3, ...] = ((0.0, 0.0, 0.0),)
    doppler_bands: int = 0

    @property
    def transmitters(self) -> int:
        return len(self.tx_positions_m)

    @property
    def turns(self) -> int:
        """Number of chirps in which every transmitter transmits once."""
        return 1 if self.doppler_bands else self.transmitters

    @property
    def positions_m(self) -> tuple[Vec3, ...]:
        """Places of the channels: all receivers of the first transmitter, then of the second, ..."""
        return tuple((t[0] + r[0], t[1] + r[1], t[2] + r[2]) for t in self.tx_positions_m for r in self.rx_positions_m)

    def seen(self, chirp: Chirp) -> Chirp:
        """Return the frame of a single transmitter with the unambiguous speeds of this array."""
        shared = self.doppler_bands or self.transmitters
        if shared == 1:
            return chirp
        return chirp.model_copy(update={"chirps": chirp.chirps // shared, "repetition_s": chirp.repetition_s * shared})

    @property
    def turn_offsets(self) -> tuple[float, ...]:
        """Return delta_p of each channel."""
        if self.turns == 1:
            return (0.0,) * len(self.positions_m)
        middle = 0.5 * (self.turns - 1)
        return tuple((p - middle) / self.turns for p in range(self.turns) for _ in self.rx_positions_m)

    def problem_with_field(self, field_deg: tuple[float, float], wavelength_m: float) -> str:
        """Return why directions within +-azimuth, +-elevation are ambiguous; "" if they are not."""
        across, up = (det_sin(angle * RAD_PER_DEG) for angle in field_deg)
        for base in _shortest(self.positions_m, wavelength_m):
            reach = abs(base[1]) * across + abs(base[2]) * up
            if reach > 0.5 * wavelength_m * _SLACK:
                ratio = 0.5 * wavelength_m / sqrt(base[1] * base[1] + base[2] * base[2])
                limit_deg = det_asin(min(1.0, ratio)) / RAD_PER_DEG
                return (
                    f"is ambiguous within the stated field of +-{field_deg[0]:g} degrees azimuth and "
                    f"+-{field_deg[1]:g} elevation: along its shortest base of ({base[1] * 1e3:.3g}, "
                    f"{base[2] * 1e3:.3g}) mm directions fold beyond +-{limit_deg:.3g} degrees; the limit is a base of "
                    f"half a wavelength, {500.0 * wavelength_m:.4g} mm"
                )
        return ""


def as_array(array: VirtualArray | Sequence[Sequence[float]]) -> VirtualArray:
    """Return the array of one transmitter at the origin for the places of receivers."""
    if isinstance(array, VirtualArray):
        return array
    return VirtualArray(tuple((float(x), float(y), float(z)) for x, y, z in array))


def _shortest(positions_m: Sequence[Vec3], wavelength_m: float) -> list[Vec3]:
    """Return the shortest bases across the axis that span the array: none, one, or two."""
    bases = [minus(a, b) for a, b in combinations(positions_m, 2)]
    apart = [b for b in bases if b[1] * b[1] + b[2] * b[2] > (_SAME_PLACE * wavelength_m) ** 2]
    apart.sort(key=lambda b: b[1] * b[1] + b[2] * b[2])
    found: list[Vec3] = []
    for b in apart:
        if not found:
            found.append(b)
            continue
        first = found[0]
        cross = first[1] * b[2] - first[2] * b[1]
        if cross * cross > 1e-6 * (first[1] ** 2 + first[2] ** 2) * (b[1] ** 2 + b[2] ** 2):
            return [first, b]
    return found
