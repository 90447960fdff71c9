"""Commands: one dataclass of options becomes the signature that typer reads, and starting up stays light."""

from __future__ import annotations

import inspect
import subprocess
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from hil.apps.airsim.command import Choice
from hil.apps.campaign.command import CampaignOptions
from hil.apps.campaign.find.command import SearchOptions, ShrinkOptions
from hil.apps.detect.data_sets import DataSetSeries
from hil.apps.detect.training.settings import Settings
from hil.cli import commands
from hil.cli.app import app, run_command_line
from hil.cli.commands import add_commands
from hil.cli.live import airsim
from hil.cli.offline import campaign
from hil.cli.offline.detect import data, detect, train
from hil.cli.options import QuietOption, options_of, takes
from tests.worlds.patience import PATIENCE_S


@dataclass(frozen=True)
class Greeting:
    name: Annotated[str, typer.Argument(metavar="WHO")]
    times: Annotated[int, typer.Option(min=1, help="Repetitions.")] = 2
    quiet: QuietOption = False


def test_a_dataclass_of_options_is_a_commands_signature() -> None:
    seen: list[Greeting] = []

    @takes(Greeting)
    def greet(o: Greeting) -> None:
        """Say hello."""
        seen.append(o)

    parameters = inspect.signature(greet).parameters
    assert list(parameters) == ["name", "times", "quiet"]
    assert parameters["name"].default is inspect.Parameter.empty
    assert (greet.__name__, greet.__doc__) == ("greet", "Say hello.")

    app = typer.Typer()
    app.command()(greet)
    assert CliRunner().invoke(app, ["you", "--times", "3", "-q"]).exit_code == 0
    assert CliRunner().invoke(app, ["you"]).exit_code == 0
    assert seen == [Greeting("you", 3, True), Greeting("you")]
    assert CliRunner().invoke(app, []).exit_code == 2
    assert CliRunner().invoke(app, ["you", "--times", "0"]).exit_code == 2
    assert "Say hello." in CliRunner().invoke(app, ["--help"]).output


@dataclass(frozen=True)
class Said:
    name: str = ""
    times: int = 1
    loud: bool = False


def test_an_applications_options_are_those_of_the_same_names() -> None:
    assert options_of(Said, Greeting("you", 3)) == Said("you", 3)
    assert options_of(Said, Greeting("you", 3), times=4, loud=True) == Said("you", 4, True)


@pytest.mark.parametrize(
    ("command", "application", "others"),
    [
        (campaign.RunOptions, CampaignOptions, ()),
        (campaign.ShrinkCommandOptions, ShrinkOptions, ()),
        (campaign.SearchCommandOptions, SearchOptions, ()),
        (train.TrainOptions, Settings, ("weight_decay", "average_decay")),
        (data.DataOptions, DataSetSeries, ("scenes", "size_px")),
        (airsim.AirSimOptions, Choice, ("page",)),
    ],
)
def test_every_option_of_an_application_is_one_of_its_command(
    command: Any, application: Any, others: tuple[str, ...]
) -> None:
    assert {field.name for field in fields(application)} - {field.name for field in fields(command)} == set(others)


def test_a_command_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "my_commands"
    package.mkdir()
    for name, text in {
        "__init__": "",
        "options": "x = 1\n",
        "_shared": "x = 1\n",
        "hop": "def hop():\n    print('hopped')\n",
        "group": "import typer\n\ngroup = typer.Typer()\n\n\n@group.command()\ndef a():\n    print('a of group')\n\n\n"
        "@group.command()\ndef b():\n    pass\n",
    }.items():
        (package / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    app = typer.Typer()
    add_commands(app, ["my_commands"], first=("hop",))
    assert CliRunner().invoke(app, ["hop"]).output == "hopped\n"
    assert CliRunner().invoke(app, ["group", "a"]).output == "a of group\n"
    assert CliRunner().invoke(app, ["options"]).exit_code == 2
    with pytest.raises(LookupError, match="no module 'hopp' in my_commands"):
        add_commands(typer.Typer(), ["my_commands"], first=("hopp",))
    (package / "jump.py").write_text("def jmup():\n    pass\n")
    with pytest.raises(LookupError, match=r"my_commands\.jump has no command 'jump'"):
        add_commands(typer.Typer(), ["my_commands"], first=("hop",))


def test_every_shipped_file_of_a_command_is_one() -> None:
    folder = Path(commands.__file__).parent
    for group, where in ((app, ("live", "offline")), (detect, ("offline/detect",))):
        files = {path.stem for name in where for path in (folder / name).iterdir() if path.suffix in (".py", "")}
        named = {each.name or each.callback.__name__ for each in group.registered_commands if each.callback}
        named |= {each.name for each in group.registered_groups if each.name}
        assert {name for name in files if not name.startswith("_")} - set(commands.HELPERS) == named


@pytest.mark.parametrize("command", ["--help", "run --help", "detect train --help"])
def test_help_loads_nothing_heavy(command: str) -> None:
    heavy = ("numpy", "mujoco", "zmq", "scipy", "yaml", "cv2", "matplotlib", "sim", "firmware_bridge")
    code = (
        "import sys\n"
        "from hil.cli.app import run_command_line\n"
        f"assert run_command_line({command.split()!r}) == 0\n"
        f"print([name for name in {heavy!r} if name in sys.modules], file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert done.stderr == "[]\n"


def test_a_signal_outside_the_flight_is_no_status_of_typer(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> str:
        raise KeyboardInterrupt("stopped by SIGTERM")

    monkeypatch.setattr("hil.apps.fly.check.check_bench", stopped)
    with pytest.raises(KeyboardInterrupt, match="SIGTERM"):
        run_command_line(["check"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "--out", ""], "--out is empty"),
        (["run", "--out="], "--out is empty"),
        (["check", "--set", "seed=0x" + "f" * 60_000], "is a number of 60002 characters"),
        (["check", "--set", "seed=" + "9" * 60_000], "is a number of 60000 characters"),
        (["run", "--out", f"x/{'a' * 256}/y"], "--out has a name of 256 bytes; a file system takes 255"),
        (["bench", "physics", f"--json={'ä' * 130}"], "--json has a name of 260 bytes"),
        (["replay", "a" * 260], "an argument has a name of 260 bytes"),
        (["run", "--out", "a\udcff"], "a\\xff is not UTF-8"),
        (["check", ":smile:[red]x.yaml"], ":smile:[red]x.yaml: no such file"),
        (["replay", __file__], "is a file, not the folder of a run"),
    ],
)
def test_odd_arguments_have_a_clear_message(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--fix"], "--check PORT"), (["--check", "/dev/null", "--timing", "/dev/null"], "cannot go with --check")],
)
def test_options_of_devices_that_would_do_nothing_are_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """`hil devices --fix` listed the devices, corrected nothing, and ended with status 0."""
    result = CliRunner().invoke(app, ["devices", *arguments])
    assert result.exit_code == 2
    assert words in " ".join((result.output + "".join(capsys.readouterr())).split())
