"""Random numbers of one feature, and the shapes that they are wanted in."""

from __future__ import annotations

from hil.signals._kernel import det_pow
from sim.scene.maps.dice import Dice


def dice(seed: int, feature: str, *names: object) -> Dice:
    """Of one feature; further names for what is drawn once for each surface, person or sensor."""
    return Dice(seed, ".".join(("randomize", feature, *map(str, names))))


def between(rolled: Dice, limits: tuple[float, float]) -> float:
    """Evenly within limits."""
    return rolled.between(limits[0], limits[1])


def between_logarithms(rolled: Dice, limits: tuple[float, float]) -> float:
    """Evenly in the logarithm: as likely from 1 to 10 as from 10 to 100. Limits above 0."""
    low, high = limits
    value = low * det_pow(high / low, rolled.unit())
    return min(max(value, low), high)


def colour_of(hue: float, saturation: float, value: float) -> tuple[float, float, float]:
    """sRGB of a colour; hue 0 to 1 once round from red over green and blue (the HSV hexagon)."""
    sector = (hue % 1.0) * 6.0

    def channel(n: float) -> float:
        k = (n + sector) % 6.0
        return value - value * saturation * max(0.0, min(k, 4.0 - k, 1.0))

    return channel(5.0), channel(3.0), channel(1.0)
