"""The same geometry in AeroSandbox's vortex lattice (Sharpe, MIT, 2021): another program's coefficients beside ours.

Its wings are flat plates with a lift slope of 2 pi and no viscosity, so that `inviscid` gives our panels the same
assumptions: slope 2 pi, no profile drag, surfaces as effective as thin airfoil theory has it. Bodies are left out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hil.apps.vehicle.coefficients import Coefficients, FlightPoint, PanelAircraft
from signals.errors import HilError
from sim.physics.forces.panels import Panels, Wing

INSTALL = "pip install 'hil-bench[aero]'"
_SPANWISE, _CHORDWISE = 5, 6  # panels of each section of a half, and along the chord
_GAP = 0.004  # of the half's length, between the sections at a flap's end


def aerosandbox() -> Any:
    """Return the module. Raises HilError if it is missing."""
    try:
        import aerosandbox as asb
    except ImportError as error:
        raise HilError(f"coefficients of AeroSandbox need aerosandbox, which is missing: {INSTALL}") from error
    return asb


def inviscid(panels: Panels) -> Panels:
    """Return panels with the assumptions of the lattice."""
    wings = []
    for wing in panels.wings:
        flat = {"lift_slope_per_rad": 2.0 * math.pi, "cd0": 1e-9, "cd_cl2": 0.0, "zero_lift_deg": 0.0, "cm0": 0.0}
        wings.append(wing.model_copy(update={"airfoil": wing.airfoil.model_copy(update=flat)}))
    surfaces = tuple(s.model_copy(update={"effectiveness": 1.0}) for s in panels.surfaces)
    return panels.model_copy(update={"wings": tuple(wings), "bodies": (), "surfaces": surfaces})


class LatticeAircraft(PanelAircraft):
    """The same interface with AeroSandbox's lattice behind it."""

    def __init__(self, panels: Panels) -> None:
        self._asb = aerosandbox()
        super().__init__(panels)

    def coefficients(self, at: FlightPoint) -> Coefficients:
        asb = self._asb
        deflections = at.deflections_rad or (0.0,) * len(self.panels.surfaces)
        wings = [
            self._wing(wing, half, deflections)
            for wing in self.panels.wings
            for half in range(2 if wing.symmetric else 1)
        ]
        airplane = asb.Airplane(
            name="vehicle", xyz_ref=[0, 0, 0], wings=wings, s_ref=self.area_m2, c_ref=self.chord_m, b_ref=self.span_m
        )
        p, q, r = at.rates_radps
        point = asb.OperatingPoint(
            velocity=at.airspeed_mps, alpha=math.degrees(at.alpha_rad), beta=math.degrees(at.beta_rad), p=p, q=q, r=r
        )
        solved = asb.VortexLatticeMethod(
            airplane, point, xyz_ref=[0, 0, 0], spanwise_resolution=_SPANWISE, chordwise_resolution=_CHORDWISE
        ).run()
        return {name: float(np.real(solved[name])) for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn")}

    def _wing(self, wing: Wing, half: int, deflections: tuple[float, ...]) -> Any:
        """Return one half as a wing of AeroSandbox, whose axes are x aft, y right, z up.

        Its lattice takes deflections from the camber of the sections, so sections stand on both sides of a flap's end.
        """
        asb = self._asb
        on_wing = [(i, s) for i, s in enumerate(self.panels.surfaces) if s.wing == wing.name and s.gearing(half)]
        inner = {edge + side for _, s in on_wing for edge in s.span for side in (-_GAP, _GAP) if 0.0 < edge < 1.0}
        dihedral, sweep = math.radians(wing.dihedral_deg), math.radians(wing.sweep_deg)
        side = 1.0 if half else -1.0
        sections = []
        for share in sorted({0.0, 1.0} | inner):
            way = share * wing.half_m
            chord = wing.root_chord_m + share * (wing.tip_chord_m - wing.root_chord_m)
            airfoil = asb.Airfoil("naca0003")
            for i, surface in on_wing:
                if surface.span[0] - 1e-9 <= share <= surface.span[1] + 1e-9:
                    airfoil = airfoil.add_control_surface(
                        deflection=math.degrees(surface.gearing(half) * deflections[i]),
                        hinge_point_x=1.0 - surface.chord_ratio,
                    )
            x, y, z = wing.root_m
            sections.append(
                asb.WingXSec(
                    xyz_le=[
                        -x + way * math.tan(sweep) - 0.25 * chord,
                        side * (y + way * math.cos(dihedral)),
                        z + way * math.sin(dihedral),
                    ],
                    chord=chord,
                    twist=wing.incidence_deg + share * wing.twist_deg,
                    airfoil=airfoil,
                )
            )
        # The order of the sections gives the side of the normal: from left to right it points up.
        return asb.Wing(name=f"{wing.name}_{half}", xsecs=sections if half else sections[::-1], symmetric=False)
