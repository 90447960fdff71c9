"""Transit: how likely an object that left at the end of one track is the one that another track begins with.

    ln p(place where b begins | it is a) / p(place | anyone),   p(place | anyone) = 1 / `_AREA_M2`

a stays   a normal distribution about its last place
a walks   most walk on: a normal distribution about the place that a's velocity predicts. Walkers keep their speed and
          follow paths that bend, so with `_PACE` the deviation of the speed as a share of it, and `_BEND` that of the
          rate of turn [rad/s], the deviations are

              along v: `_PACE` v dt        across v: `_BEND` v dt^2 / 2

          and b's first velocity is that of a, turned by `_BEND` dt:

              ln N(v_b; v_a, V) / N(v_b; 0, `_ANY_MPS`^2)

          The others may be anywhere within reach, a disc of radius `_WALK_MPS` dt, of which the park is the greatest.

Who was seen to stand may have got up, and the reverse, with the chance `_CHANGES`; of a track too short to tell, both
have the same chance.
"""

from __future__ import annotations

import math

import numpy as np

from hil_companion.locate.tracks import FIRST_SPEED_MPS, Track

_AREA_M2, _WALK_MPS = 3600.0, 1.8
_STAYS_M2 = 0.15  # variance of the place of an object that stays, besides that of the tracks
_CHANGES, _STANDING = 0.05, 0.4  # chance of a change between two tracks, and share of tracks of those who stand
_ONWARD, _BACK, _PACE, _BEND = (
    0.6,
    0.15,
    0.1,
    0.05,
)  # the round walk of a park, 30 m in radius, turns a walker by 0.04 rad/s
_MEASURED = 0.9  # share of the variance of anyone's velocity above which a velocity says nothing
_BEYOND_M, _PER_BEYOND_M = 6.0, 0.8  # out of reach; a wrong range at the end of a track is worth this
_SPLIT_S, _ONE_BODY_M = 1.1, 0.7  # two boxes on one person for a moment; two people are farther from each other
_LOST_S = 30.0  # after this time the bends of the path leave nothing of the direction


def transit_ratio(a: Track, b: Track) -> float:
    """Return the log-likelihood ratio; -inf if b does not begin after a or cannot be reached."""
    dt = (b.first.t_ns - a.t_ns) * 1e-9
    if dt <= 0.0:
        return _split_ratio(a, b) if dt >= -_SPLIT_S else -math.inf
    off = b.first.state[:2] - a.state[:2]
    variance = a.sigma_m**2 + b.first.sigma_m**2 + _STAYS_M2
    away_m = float(np.hypot(*off))
    reach_m = _WALK_MPS * dt + 2.0 * math.sqrt(variance)
    stays = _normal(away_m, variance)
    beyond_m = max(0.0, away_m - reach_m)
    if beyond_m > _BEYOND_M:
        return -math.inf
    walks = max(1.0 / _AREA_M2, 1.0 / (math.pi * reach_m**2)) * math.exp(-beyond_m / _PER_BEYOND_M)
    if dt < _LOST_S:
        onward, back = _along_path(a, b, off, dt, variance)
        walks = (1.0 - _ONWARD - _BACK) * walks + _ONWARD * onward + _BACK * back
    stand_a, stand_b = _stands(a), _stands(b)
    density = (
        stand_a * stand_b / _STANDING * ((1.0 - _CHANGES) * stays + _CHANGES * walks)
        + (1.0 - stand_a) * (1.0 - stand_b) / (1.0 - _STANDING) * walks
        + _CHANGES * (stand_a * (1.0 - stand_b) + (1.0 - stand_a) * stand_b) * (stays + walks)
    )
    return -math.inf if density <= 1e-12 else math.log(density * _AREA_M2)


def _split_ratio(a: Track, b: Track) -> float:
    """Return the ratio of a track that begins a moment before the other ends: one body if at one place, else two."""
    off = a.at(b.first.t_ns)[0][:2] - b.first.state[:2]
    away_m = float(np.hypot(*off))
    if away_m > _ONE_BODY_M:
        return -math.inf
    return math.log(_AREA_M2 * _normal(away_m, a.sigma_m**2 + b.first.sigma_m**2 + _STAYS_M2))


def _along_path(a: Track, b: Track, off: np.ndarray, dt: float, variance: float) -> tuple[float, float]:
    """Return the densities of b's place, times those of its velocity over that of anyone, if a walks on or back."""
    velocity = a.state[2:]
    speed = float(np.hypot(*velocity))
    ahead = velocity / max(speed, 1e-6)
    along, across = float(off @ ahead), float(off[1] * ahead[0] - off[0] * ahead[1])
    unsure2 = 0.5 * float(a.cov[2, 2] + a.cov[3, 3])
    changes = variance + unsure2 * dt**2
    along2, across2 = changes + (_PACE * speed * dt) ** 2, changes + (0.5 * _BEND * speed * dt**2) ** 2
    beside = math.exp(-0.5 * across**2 / across2) / math.sqrt(2.0 * math.pi * across2)
    onward = math.exp(-0.5 * (along - speed * dt) ** 2 / along2) / math.sqrt(2.0 * math.pi * along2)
    # Turned at any time: anywhere from as far ahead to as far behind.
    beyond = max(0.0, abs(along) - speed * dt)
    length_m = 2.0 * speed * dt + math.sqrt(2.0 * math.pi * along2)
    back = math.exp(-0.5 * beyond**2 / along2) / length_m
    spread2 = unsure2 + (_PACE * speed) ** 2 + 0.5 * (_BEND * dt * speed) ** 2
    return beside * onward * _heads(b, velocity, spread2), beside * back * _heads(b, -velocity, spread2)


def _heads(track: Track, velocity: np.ndarray, spread2: float) -> float:
    """Return how much likelier a track's first velocity is if it should be `velocity` than if it is anyone's."""
    any2, known2 = FIRST_SPEED_MPS**2, track.first.speed_sigma_mps**2
    if known2 > _MEASURED * any2:
        return 1.0
    noise2 = any2 * known2 / (any2 - known2)  # without the prior N(0, any2) of a new track
    measured = track.first.state[2:] * (any2 / (any2 - known2))
    anyone = _normal(float(np.hypot(*measured)), any2 + noise2)
    return _normal(float(np.hypot(*(measured - velocity))), spread2 + noise2) / max(anyone, 1e-12)


def _stands(track: Track) -> float:
    """Return the chance that the object stands or sits."""
    if track.stands or 2 * track.evidence.seats >= track.sightings:
        return 1.0 - _CHANGES
    return _CHANGES if track.walks else _STANDING


def _normal(away_m: float, variance: float) -> float:
    return math.exp(-0.5 * away_m**2 / variance) / (2.0 * math.pi * variance)
