"""Patterns of classes, as both importers use them."""

from __future__ import annotations

from sim.scene.imports.class_patterns import ClassPatterns


def test_the_last_match_counts_and_others_are_known() -> None:
    patterns = ClassPatterns({"tree": ["tree_*", "oak"], "house": ["*_house", "tree_house"], "road": ["road"]})
    assert patterns.class_of(("street", ""), "object") == "object"
    assert patterns.class_of(("tree_1", "oak mesh"), "object") == "tree"
    assert patterns.class_of(("tree_house",), "object") == "house"
    assert patterns.unmatched == (("tree", 1), ("road", 0))
