#include "ekf_jacobians.hpp"

#include <cmath>

namespace hil::flight::generated {
using std::sqrt;
#include "generated/ekf_jacobians.c"
}  // namespace hil::flight::generated
