"""Applies one declared fault to one direction of the link: takes units and returns them, some of them later.

A hit is a pure function of (seed, index of the fault in the list, direction, number of the unit). Only units that the
fault can hit are numbered, and only while it is active; so the same traffic gets the same hits, however the bytes were
split and whenever they came.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from typing import Any

from firmware_bridge.codecs.mavlink_frame import message_id
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.faults.hit_log import HitLog
from firmware_bridge.faults.link_fault import Direction, LinkFault
from signals.noise import NoiseStream

_BLOCK = 256  # of NoiseStream
_LANES = 3  # random numbers of a unit: whether it is hit, which byte changes, to which value


class _Hits:
    """The hits of one stage, computed for a block of units at a time."""

    def __init__(self, seed: int, name: str, rate: float) -> None:
        self._stream = NoiseStream(seed, name, lanes=_LANES)
        self._rate = rate
        self._block_index = -1
        self._block: Any = None
        self._hits: list[int] = []

    def _load(self, block: int) -> None:
        if block != self._block_index:
            self._block_index = block
            self._block = self._stream.uniform_block(block)
            first = block * _BLOCK
            self._hits = [first + int(i) for i in (self._block[:, 0] < self._rate).nonzero()[0]]

    def any_hit(self, start: int, count: int) -> bool:
        """Return True if one of the units `start` to `start + count - 1` is hit."""
        at, end = start, start + count
        while at < end and self._rate > 0.0:
            self._load(at // _BLOCK)
            first = bisect_left(self._hits, at)
            if first < len(self._hits):
                return self._hits[first] < end
            at = (at // _BLOCK + 1) * _BLOCK
        return False

    def damage(self, number: int, unit: bytes) -> bytes:
        """Return `unit` with one byte changed."""
        self._load(number // _BLOCK)
        _, position, change = self._block[number % _BLOCK].tolist()
        at = int(position * len(unit))
        changed = unit[at] ^ (1 + int(change * 255.0))
        return unit[:at] + bytes((changed,)) + unit[at + 1 :]


class FaultStage:
    """Fault number `index` of the list, on units that travel in `direction`.

    `push` and `poll` get both times [ns], simulated and wall clock. Units that were held back come out of `poll`, or of
    `push` before (stall, delay) or after (reorder) the units pushed.
    """

    def __init__(self, index: int, fault: LinkFault, direction: Direction, *, seed: int, log: HitLog) -> None:
        self.index = index
        self._fault = fault
        self._direction: Direction = direction
        self._log = log
        self._random_hits = _Hits(seed, f"link_fault.{index}.{direction}", fault.rate or 0.0)
        self._message_ids = frozenset(MSGID[name] for name in fault.messages)
        self._begin_ns = fault.begin_ns
        self._end_ns = self._begin_ns + fault.length_ns
        self.count = 0  # units that could have been hit
        self._burst_left = 0
        self._stall_end_wall_ns: int | None = None  # of the active stall
        self._stall_over = False
        # (wall clock of its release, unit); a stall releases all of its units at once.
        self._held_units: deque[tuple[int, bytes]] = deque()
        self._overtake_left = 0

    @property
    def holds(self) -> bool:
        """True while units are held back."""
        return bool(self._held_units)

    @property
    def next_release_ns(self) -> int | None:
        """Wall clock at which `poll` releases the next unit; None if none is held."""
        if not self._held_units:
            return None
        return self._stall_end_wall_ns if self._stall_end_wall_ns is not None else self._held_units[0][0]

    def clear(self) -> None:
        """Drop the units held back: the transport was closed."""
        self._held_units.clear()
        self._burst_left = self._overtake_left = 0

    def poll(self, t_ns: int, wall_ns: int) -> list[bytes]:
        """Return the units that are due."""
        if self._stall_end_wall_ns is not None:
            if t_ns < self._end_ns and wall_ns < self._stall_end_wall_ns:
                return []
            self._stall_end_wall_ns = None
            self._stall_over = True
        out = []
        while self._held_units and self._held_units[0][0] <= wall_ns:
            out.append(self._held_units.popleft()[1])
        return out

    def push(self, units: list[bytes], t_ns: int, wall_ns: int) -> list[bytes]:
        """Pass `units` through the fault. Return the units that leave it now."""
        out = self.poll(t_ns, wall_ns)
        active = self._begin_ns <= t_ns < self._end_ns and not self._stall_over
        if active and self._fault.kind == "stall":
            return out + self._stall(units, t_ns, wall_ns)
        if not active and not self._held_units:
            return out + units
        for unit in units:
            out += (
                self._pass_bytes(unit, t_ns, wall_ns, active)
                if self._fault.unit == "byte"
                else self._pass_unit(unit, t_ns, wall_ns, active)
            )
        return out

    def _stall(self, units: list[bytes], t_ns: int, wall_ns: int) -> list[bytes]:
        if self._stall_end_wall_ns is None:
            self._stall_end_wall_ns = wall_ns + self._fault.length_ns
        for unit in units:
            self._log.hit(self.index, self._direction, unit, t_ns)
            self._held_units.append((0, unit))
        return []

    def _pass_bytes(self, unit: bytes, t_ns: int, wall_ns: int, active: bool) -> list[bytes]:
        """Pass the bytes of one unit one by one. Bytes that leave at once stay one unit."""
        quiet = not self._held_units and not self._burst_left
        if quiet and active and not self._random_hits.any_hit(self.count, len(unit)):
            self.count += len(unit)
            return [unit]
        out = []
        for i in range(len(unit)):
            out += self._pass_unit(unit[i : i + 1], t_ns, wall_ns, active)
        return [b"".join(out)] if out else []

    def _pass_unit(self, unit: bytes, t_ns: int, wall_ns: int, active: bool) -> list[bytes]:
        hit, number = False, self.count
        if active and (not self._message_ids or message_id(unit) in self._message_ids):
            hit = self._is_hit(number)
            self.count += 1
        kind = self._fault.kind
        if kind == "reorder":
            return self._reorder(unit, hit, t_ns, wall_ns)
        if hit:
            self._log.hit(self.index, self._direction, unit, t_ns)
        if kind == "delay":
            return self._delay(unit, hit, wall_ns)
        if not hit:
            return [unit]
        if kind == "drop":
            return []
        if kind == "duplicate":
            return [unit, unit]
        return [self._random_hits.damage(number, unit)]

    def _is_hit(self, number: int) -> bool:
        begins = self._random_hits.any_hit(number, 1)
        if self._fault.kind == "reorder":
            return begins
        if begins:
            self._burst_left = self._fault.burst
        hit = self._burst_left > 0
        self._burst_left -= hit
        return hit

    def _delay(self, unit: bytes, hit: bool, wall_ns: int) -> list[bytes]:
        """Delay a unit. A line keeps its order: the units after a delayed one wait for it."""
        release_ns = wall_ns + self._fault.hold_ns if hit else wall_ns
        if self._held_units:
            release_ns = max(release_ns, self._held_units[-1][0])
        elif not hit:
            return [unit]
        self._held_units.append((release_ns, unit))
        return []

    def _reorder(self, unit: bytes, hit: bool, t_ns: int, wall_ns: int) -> list[bytes]:
        """Hold back one unit at a time until `burst` others have passed."""
        if not self._held_units:
            if not hit:
                return [unit]
            self._log.hit(self.index, self._direction, unit, t_ns)
            self._held_units.append((wall_ns + self._fault.hold_ns, unit))
            self._overtake_left = self._fault.burst
            return []
        self._overtake_left -= 1
        return [unit] if self._overtake_left else [unit, self._held_units.popleft()[1]]
