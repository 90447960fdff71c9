"""The flight core gives the same bytes for the same calls, on any CPU feature set."""

from __future__ import annotations

from tests.worlds import cpu_masks
from tests.worlds.cpu_masks import output_of

# Inputs from integers only, so that nothing but the core can differ between machines. Every kind of set-point, all
# sensors, an alignment, manoeuvres hard enough to saturate, and faults.
SCRIPT = """
import hashlib, math
import numpy as np
from firmware_bridge import _native

core = _native.FlightCore(np.array(_native.PARAM_DEFAULTS))
state, controls = core.state, core.controls
word = 12345

def noise():
    global word
    word = (word * 6364136223846793005 + 1442695040888963407) % 2**64
    return (word >> 33) / 2.0**30 - 1.0

digest = hashlib.sha256()
kinds = [(0,), (1,), (2, 1.0, 2.0, -5.0, 0.5, 0.1, 0.0, 1.0, 0.0), (3, 0.0, 0.0, 0.0, 1.0, -1.0, -0.5, math.nan, 0.3),
         (4, 0.3, -0.4, 0.7, 0.0, 0.0, 0.0, -2.0, 0.0), (5, 1.0, -2.0, 0.5, 0.6), (2, math.nan, 9.0, -3.0)]
for k in range(1, 5001):
    t = 4000 * k
    shake = 0.0 if k < 600 else 0.3
    if k % 25 == 0:
        core.update_gps(t, 47.4 + 1e-7 * noise(), 8.5 + 1e-7 * noise(), 488.0 + 0.02 * noise(),
                        0.05 * noise(), 0.05 * noise(), 0.05 * noise(), 0.03, 0.05)
    if k > 600 and k % 400 == 0:
        core.set_setpoint(*kinds[(k // 400) % len(kinds)])
    core.step(t, *(0.01 + (0.002 + shake) * noise() for _ in range(3)),
              *(a + (0.03 + shake) * noise() for a in (0.3, -0.2, -9.8)))
    if k % 5 == 0:
        core.update_baro(t, 500.0 + 0.1 * noise())
        core.update_mag(t, 0.2 + 0.002 * noise(), 0.05 + 0.002 * noise(), 0.43 + 0.002 * noise())
    if k % 999 == 0:
        core.step(t + 1, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0)
    digest.update(state.tobytes())
    digest.update(controls.tobytes())
assert state[_native.STATE_FIELDS["yaw_aligned"][0]] == 1.0
assert np.isfinite(state).all()
print(digest.hexdigest())
"""


def test_same_bytes_with_cpu_features_masked():
    plain = output_of(SCRIPT)
    assert len(plain) == 64
    assert output_of(SCRIPT) == plain
    assert output_of(SCRIPT, cpu_masks.ALL) == plain
