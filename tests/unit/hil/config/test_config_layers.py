"""Merged settings: the origin of a value is that of the layer that it comes from."""

from __future__ import annotations

from hil.config.layers import Settings
from signals.documents.yaml_lines import parse_yaml


def test_what_a_later_layer_replaces_leaves_no_origin() -> None:
    settings = Settings()
    settings.merge(parse_yaml("a: [1, 2, 3]\nb: {c: 1, d: 2}\ne: {f: 1}\n", "first.yaml"))
    settings.merge(parse_yaml("# later\na: [4]\nb: null\ne: {g: 2}\n", "second.yaml"))
    assert settings.data == {"a": [4], "b": None, "e": {"f": 1, "g": 2}}
    assert settings.where(("a", 0)) == settings.where(("a", 2)) == "second.yaml:2"
    assert settings.where(("b", "d")) == "second.yaml:3"
    assert (settings.where(("e", "f")), settings.where(("e", "g"))) == ("first.yaml:3", "second.yaml:4")
