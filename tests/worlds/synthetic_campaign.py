"""A campaign's file and a store of invented outcomes: flights fail in strong wind from the west on firmware b."""

from __future__ import annotations

import hashlib
import random
from pathlib import Path

from hil.apps.campaign.cases.campaign_file import CampaignFile, load_campaign
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.flight import Limit, Outcome
from hil.apps.campaign.results.page import Facts
from hil.apps.campaign.store import Store

FILE = """
description: Invented outcomes
settings: {{wind: {{steady_W_mps: [0, 0, 0]}}}}
axes:
  scene: [airfield, city_park]
  autopilot.binary: [a.elf, b.elf]
samples: {samples}
sampled:
  wind.steady_W_mps.0: {{uniform: [-8, 8]}}
  vehicle_settings.mass_kg: {{normal: [2.06, 0.08]}}
  faults.sensors: {{choice: [[], [{{sensor: gps, kind: dropout, at_s: 14, until_s: 16}}]]}}
  seed: {{integers: [1, 1000000]}}
"""


def campaign_file(folder: Path, samples: int) -> CampaignFile:
    """Write and read the file of a campaign with four cases for each sample."""
    path = folder / "invented.yaml"
    path.write_text(FILE.format(samples=samples))
    return load_campaign(path)


def fill(store: Store, file: CampaignFile, *, lenient: float = 0.0) -> None:
    """Store an outcome for every point. `lenient`: wind [m/s] that firmware b stands beyond its usual."""
    store.begin_plan()
    store._db.do("BEGIN")  # one transaction: a synthetic store needs no safety from power cuts
    for point in Plan(file):
        case = hashlib.blake2b(repr(point.texts).encode(), digest_size=10).hexdigest()
        store.add_point(point.number, case, point.values)
        store.put(case, outcome(point.values, case, lenient), point.texts)
        if point.number % 100 == 7:
            store.put_check(case, "0" * 64, "tick 3, port imu: differs" if point.number % 1000 == 7 else "")
    store._db.do("COMMIT")


def outcome(axes, case: str, lenient: float) -> Outcome:  # type: ignore[no-untyped-def]
    """Return the outcome of a case, a function of its axes and name alone."""
    generator = random.Random(case)
    if generator.random() < 0.002:
        return Outcome("ERROR", error_type="LockstepLost", error="no answer to tick 17 <within> 5 s", repeatable=False)
    excess = max(0.0, axes["wind.steady_W_mps.0"] - 4.0 - lenient) * (axes["autopilot.binary"] == "b.elf")
    cross_m = 0.3 + 0.02 * axes["wind.steady_W_mps.0"] ** 2 * generator.random() + 0.5 * excess * generator.random()
    tilt_deg = abs(generator.gauss(5.0, 3.0))
    limits = (
        Limit("max_cross_track_m", cross_m, 1.5, "m", cross_m <= 1.5),
        Limit("landed_tilt_deg", tilt_deg, 30.0, "deg", tilt_deg <= 30.0),
        Limit("landing_speed_mps", None, 2.0, "m/s", None),
    )
    failed = cross_m > 1.5
    reasons = (f"max_cross_track_m is {cross_m:.3g} m, more than the 1.5 m allowed",) if failed else ()
    return Outcome("FAIL" if failed else "PASS", reasons, "", "", limits, "ab" * 32, True, 24.0, 2.5)


def facts(file: CampaignFile, folder: Path) -> Facts:
    """Return the facts of a complete synthetic campaign."""
    points = len(Plan(file))
    return Facts(file.name, file.spec.description, folder, Path("hil.yaml"), points, "", True, points, 60.0)
