// sim._kernels.number_row, number_rows: numbers as rows of a table. Contract: number_text.hpp.
#include <nanobind/nanobind.h>

#include <cstdint>
#include <string>

#include "number_text.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

void add_number(std::string &text, PyObject *value) {
    const double x = PyFloat_AsDouble(value);
    if (x == -1.0 && PyErr_Occurred()) throw nb::python_error();
    char number[hil::sim::kLongestNumber];
    text.append(number, hil::sim::number_text(x, number));
}

// A number, or all of a tuple, with commas between them.
void add_numbers(std::string &text, PyObject *part) {
    if (!PyTuple_Check(part)) return add_number(text, part);
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(part); ++i) {
        if (i) text += ',';
        add_number(text, PyTuple_GET_ITEM(part, i));
    }
}

nb::str number_row(nb::args values) {
    thread_local std::string text;
    text.clear();
    for (nb::handle part : values) {
        if (!text.empty() && !(PyTuple_Check(part.ptr()) && PyTuple_GET_SIZE(part.ptr()) == 0)) text += ',';
        add_numbers(text, part.ptr());
    }
    return nb::str(text.data(), text.size());
}

// Of tuples alone, so that nothing can be changed or go away meanwhile.
nb::str number_rows(nb::list rows, nb::tuple columns, std::int64_t before, std::int64_t later) {
    thread_local std::string text;
    text.clear();
    const Py_ssize_t time = nb::cast<Py_ssize_t>(columns[0]);
    for (nb::handle row : rows) {
        PyObject *const r = row.ptr();
        const auto field = [&](Py_ssize_t i) {
            if (!PyTuple_Check(r) || i < 0 || i >= PyTuple_GET_SIZE(r)) throw nb::index_error("a row has no such column");
            return PyTuple_GET_ITEM(r, i);
        };
        long long t_ns = PyLong_AsLongLong(field(time));
        if (t_ns == -1 && PyErr_Occurred()) throw nb::python_error();
        t_ns += later;
        if (t_ns <= before) {
            throw nb::value_error(("time must rise from row to row, but " + std::to_string(t_ns) + " ns follows " +
                                   std::to_string(before) + " ns").c_str());
        }
        before = t_ns;
        text += std::to_string(t_ns);
        for (std::size_t k = 1; k < columns.size(); ++k) {
            text += ',';
            const nb::handle column = columns[k];
            if (PyLong_Check(column.ptr())) add_numbers(text, field(nb::cast<Py_ssize_t>(column)));
            else add_numbers(text, column.ptr());
        }
        text += '\n';
    }
    return nb::str(text.data(), text.size());
}

}  // namespace

void bind_number_text(nb::module_ &m) {
    m.def("number_row", number_row, "values"_a,
          "Numbers and tuples of numbers as Python's repr writes floats, with commas between them.");
    m.def("number_rows", number_rows, "rows"_a, "columns"_a, "before"_a, "later"_a = 0,
          "A table's rows, of tuples: first the time [ns] in column `columns[0]`, a whole number, plus `later`; it must "
          "rise from row to row and from `before` (ValueError). Then each column named by its place, or a tuple as it is.");
}
