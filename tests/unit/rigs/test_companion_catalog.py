"""CUTs by name: the user's own classes with their settings."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config.companion.clients import make_client_importable

make_client_importable()

from hil_companion import Client  # noqa: E402
from hil_companion.catalog import make_cut  # noqa: E402
from hil_companion.errors import OptionError  # noqa: E402

OWN_CUTS = """
from hil_companion.cuts.waypoints import Waypoints


class Plain:
    def __init__(self, *, gain=1.0, mode="soft"):
        self.settings = (gain, mode)

    def __call__(self, frame):
        return None


class Inherited(Waypoints):
    pass


class Extended(Waypoints):
    def __init__(self, *, gain=1.0):
        super().__init__(speed_mps=2.0 * gain)
"""


@pytest.fixture
def own_cuts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    name = f"own_cuts_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(OWN_CUTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


def test_a_class_of_the_users_takes_its_keyword_arguments_as_settings(own_cuts: str) -> None:
    assert make_cut(f"{own_cuts}:Plain", ["gain=3", "mode=hard"]).settings == (3, "hard")
    assert make_cut(f"{own_cuts}:Extended", ["gain=0.5"])._limits.speed_mps == 1.0
    assert make_cut(f"{own_cuts}:Inherited", ["speed_mps=2"])._limits.speed_mps == 2
    for cut, legal in (("Plain", "gain, mode"), ("Extended", "gain"), ("Inherited", "speed_mps, .*, busy_s")):
        with pytest.raises(OptionError, match=f"{cut} has no setting 'tempo'; it has {legal}$"):
            make_cut(f"{own_cuts}:{cut}", ["tempo=1"])


@pytest.mark.parametrize(("cut", "near"), [("waypoints", "speed_mps"), ("explore", "localiser"), ("record", "stop")])
def test_an_unknown_setting_of_a_shipped_cut_names_the_nearest_and_all(cut: str, near: str) -> None:
    with pytest.raises(
        OptionError, match=rf"^{cut} has no setting '{near}x'; did you mean '{near}'\?; it has .*{near}"
    ):
        make_cut(cut, [f"{near}x=1"])


def test_all_keywords_of_connect_are_checked() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'credits'"):
        Client.connect("tcp://127.0.0.1:1", name="test", credits=2)
    with pytest.raises(OptionError, match="give both or neither"):
        Client.connect("tcp://127.0.0.1:1", name="test", key="jetson.key")
