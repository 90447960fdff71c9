"""CasADi's functions as straight-line programs that run for many instants at once (`native/programs.cpp`).

CasADi interprets an SX function instant by instant, at 5 ns an operation, and copies its arguments. Here one operation
runs over a block of instants before the next one, on arrays that the caller owns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hil.apps.identify._programs import StraightLine

Array = NDArray[np.float64]

# CasADi's names in the order of `Op` in programs.cpp.
_OPERATIONS = (
    *("CONST", "INPUT", "OUTPUT", "ASSIGN", "NEG", "TWICE", "SQ", "INV", "SQRT", "EXP", "LOG", "SIN", "COS", "TAN"),
    *("ASIN", "ACOS", "ATAN", "SINH", "COSH", "TANH", "FABS", "SIGN", "NOT", "FLOOR", "CEIL", "EXPM1", "LOG1P", "ERF"),
    *("ADD", "SUB", "MUL", "DIV", "POW", "FMIN", "FMAX", "ATAN2", "HYPOT", "COPYSIGN", "LT", "LE", "EQ", "NE", "AND"),
    *("OR", "IF_ELSE_ZERO"),
)
_SAME = {"CONSTPOW": "POW"}
_NUMBER_OF = {getattr(ca, f"OP_{name}"): k for k, name in enumerate(_OPERATIONS)}
_NUMBER_OF |= {getattr(ca, f"OP_{name}"): _OPERATIONS.index(other) for name, other in _SAME.items()}
_FIRST_OF_TWO = _OPERATIONS.index("ADD")


def straight_line(function: Any, columns: Sequence[NDArray[np.int64]]) -> StraightLine:
    """Return the program of an SX function. `columns[k]`: where each nonzero of output k goes in a row of its array.

    Raises ValueError for an operation that the programs do not have.
    """
    code = np.zeros((function.n_instructions(), 4), np.int32)
    constants: list[float] = []
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        read, written = function.instruction_input(k), function.instruction_output(k)
        if kind not in _NUMBER_OF:
            raise ValueError(f"{function.name()}: CasADi's operation {kind} is none of {', '.join(_OPERATIONS)}")
        number = _NUMBER_OF[kind]
        if _OPERATIONS[number] == "CONST":
            code[k] = number, len(constants), 0, written[0]
            constants.append(function.instruction_constant(k))
        elif _OPERATIONS[number] == "INPUT":
            code[k] = number, read[0], read[1], written[0]
        elif _OPERATIONS[number] == "OUTPUT":
            code[k] = number, read[0], columns[written[0]][written[1]], written[0]
        else:
            code[k] = number, read[0], read[1] if number >= _FIRST_OF_TWO else 0, written[0]
    return StraightLine(code.ravel(), np.array(constants, np.float64), function.sz_w())
