"""Straight-line programs: CasADi's values for every operation; the fit is the same with them, and with any threads."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.identify._programs import StraightLine
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit import shooting
from hil.apps.identify.fit.flight_model import Differentiated, FlightModel, make_model
from hil.apps.identify.fit.shooting import Group, Guess, Sums, first_states, solve, sums
from hil.apps.identify.fit.windows import Motors, Windows
from hil.apps.identify.straight_line import straight_line
from tests.worlds.excited_flight import Sensing, excited_log, hidden_vehicle, nominal_vehicle

Array = NDArray[np.float64]
X, Y = ca.SX.sym("x"), ca.SX.sym("y")
EXPRESSIONS = {
    "rational": (X * Y + 2 * X - Y / (1 + X * X)) * (-Y) + 1 / X,
    "roots": ca.sqrt(ca.fabs(X)) + ca.fmin(X, Y) * ca.fmax(X, 0.3) + ca.sign(X) * ca.copysign(0.7, Y),
    "circular": ca.sin(X) * ca.cos(Y) + ca.tan(0.3 * X) + ca.atan(Y) + ca.atan2(X, Y),
    "arcs": ca.asin(ca.tanh(X)) + ca.acos(ca.tanh(Y)),
    "hyperbolic": ca.sinh(X) - ca.cosh(Y) + ca.tanh(X * Y),
    "growth": ca.exp(X) + ca.log(1 + Y * Y) + ca.expm1(X) + ca.log1p(X * X) + ca.erf(Y) + ca.hypot(X, Y),
    "powers": ca.fabs(X) ** Y + ca.fabs(Y) ** 2.6 + X**3,
    "steps": ca.floor(3 * X) + ca.ceil(3 * Y),
    "logic": ca.if_else(X > Y, X, 2 * Y) + ca.if_else(ca.logic_or(X <= 0, Y != 0.5), 1, 3)
    + ca.if_else(ca.logic_and(ca.logic_not(X < 0.2), Y == Y), X, 0),
}  # fmt: skip


@pytest.mark.parametrize("name", EXPRESSIONS)
@pytest.mark.parametrize("count", [1, 31, 32, 77])
def test_a_program_has_the_values_of_casadi(name: str, count: int) -> None:
    function = ca.Function("f", [X, Y], [EXPRESSIONS[name]])
    random = np.random.default_rng(count)
    x, y = (np.ascontiguousarray(random.uniform(-1.5, 1.5, (1, count))) for _ in range(2))
    out = np.full((count, 2), 7.0)
    straight_line(function, [np.array([1])]).evaluate([x, y], [out])
    expected = np.array([float(function(a, b)) for a, b in zip(x[0], y[0], strict=True)])
    np.testing.assert_allclose(out[:, 1], expected, rtol=4e-15, atol=1e-15)
    assert (out[:, 0] == 7.0).all()  # a column that the program does not name


def test_programs_refuse_what_does_not_fit() -> None:
    with pytest.raises(ValueError, match="f: CasADi's operation"):
        straight_line(ca.Function("f", [X], [ca.erfinv(X)]), [np.array([0])])
    program = straight_line(ca.Function("f", [X, Y], [X * Y]), [np.array([0])])
    one, out = np.ones((1, 5)), np.zeros((5, 1))
    program.evaluate([np.full((1, 1), 3.0), one], [out])
    assert (out == 3.0).all()
    for inputs, outputs, message in (
        ([one], [out], "reads row 0 of input 1"),
        ([one, np.ones((1, 4))], [out], "has 4 instants, not 5"),
        ([one, one], [np.zeros((5, 0))], "writes column 0 of output 0"),
        ([one, one], [out, np.zeros((4, 1))], "differ in their number"),
        ([one, one], [], "needs an output"),
    ):
        with pytest.raises(ValueError, match=message):
            program.evaluate(inputs, outputs)
    with pytest.raises(TypeError):
        program.evaluate([one.astype(np.float32), one], [out])
    for code in ([99, 0, 0, 0], [1, 0, 0, 9], [0, 3, 0, 0], [28, 0, -1, 0]):
        with pytest.raises(ValueError, match="an instruction is none"):
            StraightLine(np.array(code, np.int32), np.zeros(1), 2)


class Interpreted:
    """CasADi's own interpreter behind the call of a program."""

    def __init__(self, f: Differentiated) -> None:
        (row_z, col_z), (row_s, col_s) = f.by_z, f.by_s
        n, nz, ns = f.shape
        self._columns = [np.arange(n), row_z * nz + col_z, row_s * ns + col_s]
        self._function = f.function

    def evaluate(self, inputs: Sequence[Array], outputs: Sequence[Array]) -> None:
        count = len(outputs[0])
        whole = [np.repeat(x, count, axis=1) if x.shape[1] == 1 else x for x in inputs]
        for columns, out, value in zip(self._columns, outputs, self._function.map(count)(*whole), strict=True):
            out[:, columns] = value.full().T


@pytest.fixture(scope="module")
def fitted() -> tuple[FlightModel, Any]:
    """Return a model and the function that makes a group of 40 windows of a flight."""
    vehicle = nominal_vehicle()
    log = excited_log(hidden_vehicle(vehicle, 5), seed=5, duration_s=9.0, sensing=Sensing(imu_delay_s=0.005))
    unknowns = at.vehicle_unknowns(vehicle) + at.log_unknowns("a")
    model = make_model(vehicle, unknowns, kind="command", step_s=0.008)
    starts_s = 1.0 + 0.16 * np.arange(40)

    def group() -> Group:
        made = first_states(model, Windows(log, 0, starts_s, 20, 0.008, Motors.of(log), 1.0))
        made.z0[13:17] = made.prior_mean[13:17] = 700.0
        return made

    return model, group


def _solved(model: FlightModel, group: Group, workers: ThreadPoolExecutor | None = None) -> shooting.Solution:
    count = at.VEHICLE_COUNT + at.LOG_COUNT
    free = np.ones(count, bool)
    free[[at.VOLTAGE, at.CENTRE + 2]] = False
    unknowns = at.vehicle_unknowns(nominal_vehicle()) + at.log_unknowns("a")
    guess = Guess(np.zeros(count), np.array([u.prior for u in unknowns]), free)
    return solve(model, [group], guess, steady=None, progress=lambda share, what: None, most=5, workers=workers)


def test_the_fit_is_that_of_casadis_interpreter(fitted: tuple[FlightModel, Any], monkeypatch: Any) -> None:
    """Five Gauss-Newton steps: theta within 1e-8 of its deviations, deviations within 1e-8 of themselves."""
    model, group = fitted
    fast = _solved(model, group())
    monkeypatch.setattr(Differentiated, "program", property(Interpreted))
    slow = _solved(model, group())
    sigma = np.sqrt(np.diag(slow.covariance))
    assert np.abs(fast.s - slow.s).max() <= 1e-8 * sigma[sigma > 0.0].min()
    np.testing.assert_allclose(np.sqrt(np.diag(fast.covariance)), sigma, rtol=1e-8)
    assert fast.cost == pytest.approx(slow.cost, rel=1e-12)


def test_threads_and_chunks_change_no_bit(fitted: tuple[FlightModel, Any], monkeypatch: Any) -> None:
    model, group = fitted
    alone = _solved(model, group())
    with ThreadPoolExecutor(3) as workers:
        shared = _solved(model, group(), workers)
        monkeypatch.setattr(shooting, "_CHUNK", 7)
        other = _solved(model, group(), workers)
    for found in (shared, other):
        np.testing.assert_array_equal(found.s, alone.s)
        np.testing.assert_array_equal(found.covariance, alone.covariance)
        assert found.cost == alone.cost


def test_windows_are_summed_each_by_itself(fitted: tuple[FlightModel, Any]) -> None:
    """A window's part does not depend on the windows beside it."""
    model, group = fitted
    s = np.full(at.VEHICLE_COUNT + at.LOG_COUNT, 0.01)
    whole = sums(model, group(), s)
    some = group()
    chosen = np.array([3, 17, 39])
    some.windows.starts_s = some.windows.starts_s[chosen]
    for name in ("z0", "prior_mean", "prior_weight"):
        setattr(some, name, np.ascontiguousarray(getattr(some, name)[:, chosen]))
    part = sums(model, some, s)
    for name in Sums.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[chosen])
