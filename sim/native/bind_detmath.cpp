// Exposes hil/signals/native/detmath.hpp to Python so that tests can sweep it against exact references
// and Python code can use the same machine-independent functions.
#include <nanobind/nanobind.h>

#include "detmath.hpp"

namespace nb = nanobind;

void bind_detmath(nb::module_ &m) {
    m.def("det_sin", &hil::det::sin, nb::arg("x_rad"));
    m.def("det_cos", &hil::det::cos, nb::arg("x_rad"));
    m.def("det_exp", &hil::det::exp, nb::arg("x"));
    m.def("det_log", &hil::det::log, nb::arg("x"));
    m.def("det_pow", &hil::det::pow, nb::arg("x"), nb::arg("y"));
    m.def("det_atan2", &hil::det::atan2, nb::arg("y"), nb::arg("x"));
    m.def("det_asin", &hil::det::asin, nb::arg("x"));
}
