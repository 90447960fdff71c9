"""Numbers of mission items, other than places, that no autopilot can mean: negative times, absurd radii and speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from hil.config.missions.places import ACCEPTING, LOITER_RADII, LOITER_TURNS, TIMES

MAX_LOITER_M = 10_000.0  # ArduPlane takes 2550 m at most
MAX_SPEED_MPS = 340.0
_AS_IT_IS, _AS_SET = -1.0, -2.0  # speeds of DO_CHANGE_SPEED that are words
DELAY = 93  # waits where the vehicle is for param 1 [s]; -1: until a time of day
_CHANGE_SPEED = 178


def wrong_values(command: int, params: Sequence[float]) -> Iterator[tuple[int, str, str]]:
    """Yield index, message and hint for every wrong parameter of an item. A value left open (NaN) is none."""
    p1, p2 = params[:2]
    if command in TIMES and p1 < 0.0:
        yield 0, f"{TIMES[command]} {p1:g} s", "give 0 s or more"
    if command == LOITER_TURNS and p1 < 0.0:
        yield 0, f"makes {p1:g} turns", "give 0 or more; a negative radius turns counter-clockwise"
    if command in ACCEPTING and p2 < 0.0:
        yield 1, f"has the acceptance radius {p2:g} m", "give more than 0 m, or 0 for the autopilot's own"
    index = LOITER_RADII.get(command)
    if index is not None and abs(params[index]) > MAX_LOITER_M:
        yield index, f"has the loiter radius {params[index]:g} m", f"give at most {MAX_LOITER_M:g} m"
    if command == _CHANGE_SPEED and not 0.0 <= p2 <= MAX_SPEED_MPS and p2 == p2 and p2 not in (_AS_IT_IS, _AS_SET):
        hint = f"give 0 to {MAX_SPEED_MPS:g} m/s, or -1 to leave it as it is"
        yield 1, f"changes the speed to {p2:g} m/s", hint
