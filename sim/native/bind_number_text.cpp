// sim._kernels.number_row: numbers as a row of a table. Contract: number_text.hpp.
#include <nanobind/nanobind.h>

#include <string>

#include "number_text.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

nb::str number_row(nb::args values) {
    thread_local std::string text;
    text.clear();
    for (nb::handle part : values) {
        const auto add = [](nb::handle value) {
            const double x = PyFloat_AsDouble(value.ptr());
            if (x == -1.0 && PyErr_Occurred()) throw nb::python_error();
            char number[hil::sim::kLongestNumber];
            if (!text.empty()) text += ',';
            text.append(number, hil::sim::number_text(x, number));
        };
        if (PyTuple_Check(part.ptr())) {
            for (nb::handle value : nb::borrow<nb::tuple>(part)) add(value);
        } else {
            add(part);
        }
    }
    return nb::str(text.data(), text.size());
}

}  // namespace

void bind_number_text(nb::module_ &m) {
    m.def("number_row", number_row, "values"_a,
          "Numbers and tuples of numbers as Python's repr writes floats, with commas between them.");
}
