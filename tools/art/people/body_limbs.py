"""Meshes of legs, feet, arms and hands, bare and clothed."""

from __future__ import annotations

from collections.abc import Sequence

from signals.samples import Vec3
from tools.art.people.body_build import Build, Row, tube
from tools.art.people.loft import SmoothMesh, skin

_LEG_SIDES, _ARM_SIDES = 8, 6


def shank(build: Build) -> SmoothMesh:
    top = build.figure.shank_m / 2
    rows: list[Row] = [
        (-top, 0.020, 0.021, 0.018), (-top + 0.035, 0.021, 0.022, 0.019), (0.0, 0.026, 0.038, 0.030),
        (0.050, 0.028, 0.043, 0.034), (top, 0.034, 0.031, 0.031), (top + 0.020, 0.022, 0.020, 0.021),
    ]  # fmt: skip
    return tube(rows, _LEG_SIDES, girth=build.girth, caps=(0.014, 0.008))


def bare_thigh(build: Build) -> SmoothMesh:
    """Return the lower half of the thigh, for below a hem."""
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-top - 0.016, 0.025, 0.024, 0.023), (-top, 0.033, 0.030, 0.031), (-top + 0.030, 0.036, 0.034, 0.034),
        (top - 0.06, 0.048, 0.051, 0.045),
    ]  # fmt: skip
    return tube(rows, _LEG_SIDES, girth=build.girth, creases=(-1,), caps=(0.006, 0.0))


def trouser_thigh(build: Build) -> SmoothMesh:
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-top - 0.018, 0.033, 0.032, 0.029), (-top + 0.006, 0.042, 0.040, 0.037), (0.0, 0.047, 0.049, 0.044),
        (top - 0.05, 0.051, 0.056, 0.049), (top, 0.050, 0.058, 0.050), (top + 0.028, 0.036, 0.044, 0.038),
    ]  # fmt: skip
    return tube(rows, _LEG_SIDES, girth=build.girth, caps=(0.014, 0.014))


def trouser_shank(build: Build, hem: float = 0.034, low: float = -0.006, knee: float = 0.040) -> SmoothMesh:
    top = build.figure.shank_m / 2
    mid = 0.5 * (hem + knee)
    rows: list[Row] = [
        (-top + low, hem, hem + 0.006, hem - 0.004), (-top + low + 0.035, hem - 0.003, hem + 0.003, hem - 0.005),
        (0.02, mid, mid + 0.006, mid - 0.002), (top - 0.030, knee, knee + 0.002, knee - 0.002),
        (top, knee + 0.003, knee, knee - 0.002), (top + 0.022, knee - 0.011, knee - 0.013, knee - 0.012),
    ]  # fmt: skip
    return tube(rows, _LEG_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.011))


def shorts_leg(build: Build) -> SmoothMesh:
    top = build.figure.thigh_m / 2
    rows: list[Row] = [
        (-top + 0.035, 0.052, 0.052, 0.047), (0.0, 0.053, 0.055, 0.048), (top - 0.05, 0.054, 0.059, 0.050),
        (top, 0.052, 0.059, 0.051), (top + 0.028, 0.038, 0.046, 0.039),
    ]  # fmt: skip
    return tube(rows, _LEG_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.014))


def _section_across(x: float, half: float, low: float, high: float) -> list[Vec3]:
    """Return an outline in the plane x, counter-clockwise seen from ahead: a flat bottom and a round top."""
    rise = high - low
    side = [(0.94, 0.0), (1.0, 0.40), (0.66, 0.86)]
    right = [(x, -half * w, low + rise * t) for w, t in side]
    left = [(x, half * w, low + rise * t) for w, t in side]
    return [*left, (x, 0.0, high), *reversed(right)]


def _shoe_of(rows: Sequence[tuple[float, float, float, float]]) -> SmoothMesh:
    """Loft through rows x, half width, low and high z, from heel to toe."""
    outlines = [_section_across(*row) for row in rows]
    (xa, _, la, ha), (xb, _, lb, hb) = rows[0], rows[-1]
    ends = ((xa - 0.005, 0.0, 0.5 * (la + ha)), (xb + 0.002, 0.0, 0.5 * (lb + hb)))
    return skin(outlines, ends=ends, rows=[row[0] / 0.3 for row in rows])


def shoe(build: Build) -> SmoothMesh:
    sole = -build.figure.ankle_m
    return _shoe_of([
        (-0.036, 0.017, sole, 0.004), (0.010, 0.023, sole, 0.010), (0.042, 0.026, sole, -0.010),
        (0.074, 0.028, sole, -0.018), (0.098, 0.018, sole + 0.003, -0.025),
    ])  # fmt: skip


def sole(build: Build) -> SmoothMesh:
    low = -build.figure.ankle_m
    high = low + 0.011
    return _shoe_of([
        (-0.038, 0.019, low, high), (0.030, 0.026, low, high), (0.076, 0.029, low, high),
        (0.101, 0.018, low + 0.004, high),
    ])  # fmt: skip


def boot_shaft(build: Build) -> SmoothMesh:
    top = build.figure.shank_m / 2
    rows: list[Row] = [
        (-top - 0.014, 0.028, 0.024, 0.021), (-top + 0.012, 0.026, 0.028, 0.023), (-top + 0.07, 0.029, 0.034, 0.028),
    ]  # fmt: skip
    return tube(rows, 8, creases=(0, -1))


def bare_arm(build: Build) -> SmoothMesh:
    """Return the lower half of the upper arm, for below a short sleeve."""
    top = build.figure.upper_arm_m / 2
    rows: list[Row] = [
        (-top - 0.014, 0.015, 0.015, 0.014), (-top, 0.0215, 0.022, 0.021), (-0.03, 0.024, 0.024, 0.023),
        (0.02, 0.027, 0.027, 0.025),
    ]  # fmt: skip
    return tube(rows, _ARM_SIDES, girth=build.girth, creases=(-1,), caps=(0.006, 0.0))


def sleeve(build: Build, loose: float = 0.003) -> SmoothMesh:
    top = build.figure.upper_arm_m / 2
    w = loose
    rows: list[Row] = [
        (-top - 0.016, 0.019 + w, 0.019 + w, 0.018 + w), (-top, 0.025 + w, 0.026 + w, 0.024 + w),
        (0.03, 0.028 + w, 0.029 + w, 0.026 + w), (top - 0.020, 0.029 + w, 0.030 + w, 0.026 + w),
        (top - 0.002, 0.021 + w, 0.023 + w, 0.017 + w),
    ]  # fmt: skip
    return tube(rows, _ARM_SIDES, girth=build.girth, caps=(0.010, 0.010))


def short_sleeve(build: Build) -> SmoothMesh:
    top = build.figure.upper_arm_m / 2
    rows: list[Row] = [
        (-0.025, 0.032, 0.032, 0.030), (0.03, 0.032, 0.032, 0.030), (top - 0.020, 0.031, 0.032, 0.028),
        (top - 0.002, 0.022, 0.024, 0.018),
    ]  # fmt: skip
    return tube(rows, _ARM_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.010))


def forearm(build: Build) -> SmoothMesh:
    top = build.figure.forearm_m / 2
    rows: list[Row] = [
        (-top - 0.004, 0.013, 0.013, 0.011), (-0.035, 0.017, 0.017, 0.015), (0.03, 0.023, 0.023, 0.021),
        (top, 0.0215, 0.022, 0.021), (top + 0.014, 0.013, 0.013, 0.012),
    ]  # fmt: skip
    return tube(rows, _ARM_SIDES, girth=build.girth, caps=(0.003, 0.004))


def long_cuff(build: Build, loose: float = 0.003) -> SmoothMesh:
    top = build.figure.forearm_m / 2
    w = loose
    rows: list[Row] = [
        (-top + 0.004, 0.0165 + w, 0.0165 + w, 0.0145 + w), (0.02, 0.024 + w, 0.024 + w, 0.022 + w),
        (top - 0.006, 0.0255 + w, 0.026 + w, 0.024 + w), (top + 0.014, 0.019 + w, 0.019 + w, 0.018 + w),
    ]  # fmt: skip
    return tube(rows, _ARM_SIDES, girth=build.girth, creases=(0,), caps=(0.0, 0.011))


def hand(build: Build) -> SmoothMesh:
    g = 1.0 if not build.female else 0.93
    rows: list[Row] = [
        (-0.042, 0.011, 0.013, 0.008, 0.003), (-0.012, 0.019, 0.021, 0.012), (0.010, 0.022, 0.022, 0.013),
        (0.032, 0.017, 0.017, 0.0125), (0.054, 0.0125, 0.0125, 0.0105),
    ]  # fmt: skip
    mesh = tube([(*row, 0.0) if len(row) == 4 else row for row in rows], 6, girth=g, caps=(0.012, 0.003))
    thumb: list[Row] = [(-0.014, 0.006, 0.006, 0.006, 0.031), (0.012, 0.008, 0.008, 0.007, 0.022)]
    mesh.add(tube(thumb, 4, girth=g, caps=(0.009, 0.016)))
    return mesh
