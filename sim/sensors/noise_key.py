"""The key of a named noise stream, for kernels that draw natively (sim/native/noise_stream.hpp)."""

from __future__ import annotations

import hashlib


def noise_key(seed: int, name: str) -> tuple[int, int]:
    """The two key words with which `hil.signals.noise.NoiseStream(seed, name)` draws."""
    digest = hashlib.blake2b(f"{seed}\x00{name}".encode(), digest_size=16).digest()
    return int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:], "little")
