// sim._kernels.number_rows: numbers as rows of a table. Contract: number_text.hpp.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <string>
#include <vector>

#include "number_text.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

void add_number(std::string &text, double x) {
    char number[hil::sim::kLongestNumber];
    text.append(number, hil::sim::number_text(x, number));
}

// All of a tuple, with commas between them.
void add_numbers(std::string &text, PyObject *tuple) {
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(tuple); ++i) {
        if (i) text += ',';
        const double x = PyFloat_AsDouble(PyTuple_GET_ITEM(tuple, i));
        if (x == -1.0 && PyErr_Occurred()) throw nb::python_error();
        add_number(text, x);
    }
}

template <typename T>
using Array = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

// What stands in one column of every row.
struct Column {
    const double *numbers = nullptr;      // `width` a row
    const std::int64_t *whole = nullptr;  // or one whole number a row
    std::size_t width = 1;
    std::string text;  // or the same in each
};

Column column_of(nb::handle given, std::size_t rows) {
    Column column;
    const auto fits = [rows](const auto &array) {
        if (array.ndim() < 1 || array.shape(0) != rows) throw nb::value_error("a column is not as long as the times");
        return array.data();
    };
    if (Array<double> numbers; nb::try_cast(given, numbers, false) && numbers.ndim() <= 2) {
        column.numbers = fits(numbers);
        column.width = numbers.ndim() == 2 ? numbers.shape(1) : 1;
    } else if (Array<std::int64_t> whole; nb::try_cast(given, whole, false) && whole.ndim() == 1) {
        column.whole = fits(whole);
    } else if (PyTuple_Check(given.ptr())) {
        add_numbers(column.text, given.ptr());
    } else {
        throw nb::type_error("a column is an array of float64 or int64, or a tuple of numbers");
    }
    return column;
}

void add_column(std::string &text, const Column &column, std::size_t row) {
    if (column.whole) text += std::to_string(column.whole[row]);
    else if (!column.numbers) text += column.text;
    else {
        for (std::size_t k = 0; k < column.width; ++k) {
            if (k) text += ',';
            add_number(text, column.numbers[row * column.width + k]);
        }
    }
}

nb::str number_rows(nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu> times, nb::list given,
                    std::int64_t before) {
    thread_local std::string text;
    text.clear();
    std::vector<Column> columns;
    for (nb::handle column : given) columns.push_back(column_of(column, times.size()));
    for (std::size_t row = 0; row < times.size(); ++row) {
        const std::int64_t t_ns = times.data()[row];
        if (t_ns <= before) {
            throw nb::value_error(("time must rise from row to row, but " + std::to_string(t_ns) + " ns follows " +
                                   std::to_string(before) + " ns").c_str());
        }
        before = t_ns;
        text += std::to_string(t_ns);
        for (const Column &column : columns) {
            text += ',';
            add_column(text, column, row);
        }
        text += '\n';
    }
    return nb::str(text.data(), text.size());
}

}  // namespace

void bind_number_text(nb::module_ &m) {
    m.def("number_rows", number_rows, "t_ns"_a, "columns"_a, "before"_a,
          "A table's rows: first the time [ns], which must rise from row to row and from `before` (ValueError), then each "
          "column: float64 of shape (n) or (n, k), written as repr writes floats, int64 of shape (n), or a tuple of "
          "numbers that are the same in each row.");
}
