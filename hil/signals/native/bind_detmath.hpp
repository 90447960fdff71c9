// Gives a Python extension the functions of detmath.hpp as det_*: tests sweep them against exact references, and
// Python code that feeds state uses them in place of the C library's.
#pragma once

#include <nanobind/nanobind.h>

#include "detmath.hpp"

namespace hil {

inline void bind_detmath(nanobind::module_ &m) {
    m.def("det_sin", &det::sin, nanobind::arg("x_rad"));
    m.def("det_cos", &det::cos, nanobind::arg("x_rad"));
    m.def("det_exp", &det::exp, nanobind::arg("x"));
    m.def("det_log", &det::log, nanobind::arg("x"));
    m.def("det_pow", &det::pow, nanobind::arg("x"), nanobind::arg("y"));
    m.def("det_atan2", &det::atan2, nanobind::arg("y"), nanobind::arg("x"));
    m.def("det_asin", &det::asin, nanobind::arg("x"));
}

}  // namespace hil
