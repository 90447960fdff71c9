"""Compiles an MJCF text with MuJoCo: in a process with limits if it holds what a user's file describes.

The rule: a map that the bench makes itself, of its own generators and of boxes, is compiled in the bench; it is small,
and its text is known. Every text that holds a user's map is not (`SceneMap.from_file`): the map, the map with objects,
people and vehicles added, and the model of its contact.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import mujoco

from sim.scene.budget import Budget
from sim.scene.limited_process import limited

_COMPILING = "MuJoCo's compiler"
_DRAWN_BYTES = 300  # per triangle, for the search of rays in meshes and height fields


def compile_mjcf(mjcf: str, assets: Mapping[str, bytes], budget: Budget | None = None) -> mujoco.MjModel:
    """Return the compiled model; in a process of its own with the limits of `budget`, if there is one.

    Raises ValueError with MuJoCo's message; ConfigError if a limit is exceeded.
    """
    if budget is None:
        model, error = _compiled(mjcf, dict(assets))
    else:
        with tempfile.TemporaryDirectory(prefix="hil-map-") as folder:
            binary = str(Path(folder) / "map.mjb")
            arguments = (mjcf, dict(assets), binary, budget)
            error = limited(f"{__name__}:compile_to_file", *arguments, budget=budget, what=_COMPILING)
            model = None if error else mujoco.MjModel.from_binary_path(binary)
    if model is None:
        raise ValueError(error)
    return model


def _compiled(mjcf: str, assets: dict[str, bytes]) -> tuple[mujoco.MjModel | None, str]:
    """Return the model, or None and MuJoCo's message."""
    mujoco.set_mju_user_warning(_ignore)  # by default MuJoCo writes a log file into the working directory
    try:
        return mujoco.MjModel.from_xml_string(mjcf, assets), ""
    except (ValueError, mujoco.FatalError, UnicodeError) as error:
        if "alloc" in str(error).lower():
            raise MemoryError from None
        return None, str(error)
    finally:
        mujoco.set_mju_user_warning(None)


def compile_to_file(mjcf: str, assets: dict[str, bytes], binary: str, budget: Budget) -> str:
    """Write the model to a file, and return MuJoCo's message: "" if there is none.

    Raises ConfigError if the bench could not hold the model and its state.
    """
    model, error = _compiled(mjcf, assets)
    if model is not None:
        data = mujoco.MjData(model)
        state_bytes = data.nbuffer + data.narena
        budget.at_once(state_bytes, "MuJoCo's state: sensors, user data and its stack")
        triangles = model.nmeshface + 2 * model.nhfielddata
        budget.memory(mujoco.mj_sizeModel(model) + state_bytes + _DRAWN_BYTES * triangles, "the compiled model")
        mujoco.mj_saveModel(model, binary)
    return error


def _ignore(_warning: str) -> None:
    """Ignore a warning of MuJoCo: a map that compiles only has warnings about its dynamics, which are not used."""
