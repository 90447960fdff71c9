// nanobind entry point of firmware_bridge._native: one bind_* function per kernel file.
#include <nanobind/nanobind.h>

#include "bind_detmath.hpp"

namespace nb = nanobind;

void bind_flight_core(nb::module_ &m);
void bind_ekf_jacobians(nb::module_ &m);

NB_MODULE(_native, m) {
    m.doc() = "Flight-controller kernels: estimator and cascaded control of the mock Pixhawk.";
    hil::bind_detmath(m);
    bind_flight_core(m);
    bind_ekf_jacobians(m);
}
