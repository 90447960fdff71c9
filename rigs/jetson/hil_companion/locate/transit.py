"""Transit: how likely an object that left at the end of one track is the one that another track begins with.

    ln p(place where b begins | it is a) / p(place | anyone),   p(place | anyone) = 1 / `_AREA_M2`

a stays   a normal distribution about its last place
a walks   half of all walk straight on for a while: a normal distribution about the place that a's velocity predicts,
          whose variance grows as that of a velocity with random changes, q dt^3 / 3. The others may be anywhere within
          reach, a disc of radius `_WALK_MPS` dt, of which the park is the greatest.

Who was seen to stand may have got up, and the reverse, with the chance `_CHANGES`; of a track too short to tell, both
have the same chance.
"""

from __future__ import annotations

import math

import numpy as np

from hil_companion.locate.tracks import Track

_AREA_M2, _WALK_MPS = 3600.0, 1.8
_STAYS_M2 = 0.15  # variance of the place of an object that stays, besides that of the tracks
_CHANGES, _STANDING = 0.05, 0.4  # chance of a change between two tracks, and share of tracks of those who stand
_TURNS = 0.35  # random change of a walker's velocity [m/s2 / sqrt(Hz)]
_BEYOND_M, _PER_BEYOND_M = 6.0, 0.8  # out of reach; a wrong range at the end of a track is worth this
_STRAIGHT_S = 8.0  # after this time nobody walks straight on


def transit_ratio(a: Track, b: Track) -> float:
    """Return the log-likelihood ratio; -inf if b does not begin after a or cannot be reached."""
    dt = (b.first.t_ns - a.t_ns) * 1e-9
    if dt <= 0.0:
        return -math.inf
    off = b.first.state[:2] - a.state[:2]
    variance = a.sigma_m**2 + b.first.sigma_m**2 + _STAYS_M2
    away_m = float(np.hypot(*off))
    reach_m = _WALK_MPS * dt + 2.0 * math.sqrt(variance)
    stays = _normal(away_m, variance)
    beyond_m = max(0.0, away_m - reach_m)
    if beyond_m > _BEYOND_M:
        return -math.inf
    walks = max(1.0 / _AREA_M2, 1.0 / (math.pi * reach_m**2)) * math.exp(-beyond_m / _PER_BEYOND_M)
    if dt < _STRAIGHT_S:
        onward_m = float(np.hypot(*(off - a.state[2:] * dt)))
        spread = variance + (float(a.cov[2, 2] + a.cov[3, 3]) / 2.0) * dt**2 + _TURNS**2 * dt**3 / 3.0
        walks = 0.5 * walks + 0.5 * _normal(onward_m, spread)
    stand_a, stand_b = _stands(a), _stands(b)
    density = (
        stand_a * stand_b / _STANDING * ((1.0 - _CHANGES) * stays + _CHANGES * walks)
        + (1.0 - stand_a) * (1.0 - stand_b) / (1.0 - _STANDING) * walks
        + _CHANGES * (stand_a * (1.0 - stand_b) + (1.0 - stand_a) * stand_b) * (stays + walks)
    )
    return -math.inf if density <= 1e-12 else math.log(density * _AREA_M2)


def _stands(track: Track) -> float:
    """Return the chance that the object stands."""
    if track.stands:
        return 1.0 - _CHANGES
    return _CHANGES if track.walks else _STANDING


def _normal(away_m: float, variance: float) -> float:
    return math.exp(-0.5 * away_m**2 / variance) / (2.0 * math.pi * variance)
