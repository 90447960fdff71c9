// C++ face of the CasADi-generated estimator model (generated/ekf_jacobians.c, which is committed).
//
// arg[i] and res[i] point to the i-th input and output, doubles, row-major; sizes stand above each declaration.
// All pointers must be given; outputs must not alias inputs. Only + - * / sqrt inside: same bits on every machine.
#pragma once

namespace hil::flight::generated {
#include "generated/ekf_jacobians.h"
}
