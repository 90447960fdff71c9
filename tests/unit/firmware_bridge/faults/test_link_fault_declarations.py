"""Link faults declared in a bench file: read, or refused with a reason."""

from __future__ import annotations

import pytest
from pydantic import TypeAdapter, ValidationError

from firmware_bridge.faults.link_fault import LinkFault

MS = 1_000_000
SECOND = 1000 * MS


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('{"kind": "drop", "at_s": 1}', "needs rate"),
        ('{"kind": "drop", "at_s": 1, "rate": 1.5}', "less than or equal to 1"),
        ('{"kind": "drop", "at_s": 1, "rate": "0.1"}', "valid number"),
        ('{"kind": "drop", "at_s": -1, "rate": 0.1}', "greater than or equal to 0"),
        ('{"kind": "drop", "rate": 0.1}', "at_s"),
        ('{"kind": "drop", "at_s": 1, "for_s": 0, "rate": 0.1}', "greater than 0"),
        ('{"kind": "drop", "at_s": 1, "rate": 0.1, "delay_s": 1}', "delay_s has no meaning for the kind 'drop'"),
        ('{"kind": "delay", "at_s": 1, "rate": 0.1}', "needs delay_s"),
        ('{"kind": "stall", "at_s": 1, "rate": 0.1}', "rate has no meaning for the kind 'stall'"),
        ('{"kind": "stall", "at_s": 1, "unit": "byte"}', "unit has no meaning"),
        ('{"kind": "unplug", "at_s": 1, "direction": "to_autopilot"}', "direction has no meaning"),
        ('{"kind": "unplug", "at_s": 1, "burst": 2}', "burst has no meaning"),
        ('{"kind": "drop", "at_s": 1, "rate": 0.1, "messages": ["HIL_GSP"]}', "did you mean 'HIL_GPS'"),
        ('{"kind": "drop", "at_s": 1, "rate": 0.1, "messages": ["HIL_GPS"], "unit": "byte"}', "messages has no"),
        ('{"kind": "drop", "at_s": 1, "rate": 0.1, "rates": 1}', "rates"),
        ('{"kind": "burn", "at_s": 1}', "burn"),
    ],
)
def test_a_wrong_declaration_is_refused_with_a_reason(fault: str, words: str) -> None:
    with pytest.raises(ValidationError) as refusal:
        TypeAdapter(tuple[LinkFault, ...]).validate_json(f"[{fault}]", strict=True)
    assert words in str(refusal.value)


def test_a_declaration_as_a_bench_file_has_it() -> None:
    text = '[{"kind": "delay", "at_s": 2, "for_s": 1, "rate": 1, "delay_s": 0.02, "messages": ["HIL_GPS"]}]'
    (fault,) = TypeAdapter(tuple[LinkFault, ...]).validate_json(text, strict=True)
    assert (fault.begin_ns, fault.length_ns, fault.hold_ns) == (2 * SECOND, SECOND, 20 * MS)
    assert fault.acts_on("to_autopilot")
    with pytest.raises(ValidationError):
        fault.kind = "drop"  # type: ignore[misc]


def test_the_chance_that_nothing_is_hit() -> None:
    drop, stall = LinkFault(kind="drop", at_s=1.0, rate=0.1), LinkFault(kind="stall", at_s=1.0, for_s=1.0)
    assert drop.chance_of_no_hit(10) == pytest.approx(0.9**10)
    assert (drop.chance_of_no_hit(0), stall.chance_of_no_hit(0), stall.chance_of_no_hit(3)) == (1.0, 1.0, 0.0)
