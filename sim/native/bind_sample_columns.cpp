// sim._kernels.sample_columns: samples, which are tuples, turned on their side.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <initializer_list>
#include <memory>

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <typename T>
nb::object array(std::unique_ptr<T[]> data, std::initializer_list<std::size_t> shape) {
    T *const owned = data.release();
    const nb::capsule owner(owned, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(owned, shape, owner).cast();
}

// No code of Python's runs here, so that nothing can be changed or go away meanwhile.
double number(PyObject *value) {
    if (PyFloat_Check(value)) return PyFloat_AS_DOUBLE(value);
    if (!PyLong_Check(value)) throw nb::type_error("a sample is made of numbers and tuples of numbers");
    const double x = PyLong_AsDouble(value);
    if (x == -1.0 && PyErr_Occurred()) throw nb::python_error();
    return x;
}

class Column {
   public:
    Column(nb::list rows, Py_ssize_t field) : rows_(rows), count_(rows.size()), field_(field) {}

    nb::object made() const {
        if (PyTuple_Check(at(0))) return of_tuples(static_cast<std::size_t>(PyTuple_GET_SIZE(at(0))));
        bool truths = true, whole = true;
        for (std::size_t row = 0; row < count_; ++row) {
            truths = truths && PyBool_Check(at(row));
            whole = whole && PyLong_Check(at(row));
        }
        if (truths) return filled<bool>([](PyObject *value) { return value == Py_True; });
        if (whole) {
            return filled<std::int64_t>([](PyObject *value) {
                const long long x = PyLong_AsLongLong(value);
                if (x == -1 && PyErr_Occurred()) throw nb::python_error();
                return static_cast<std::int64_t>(x);
            });
        }
        return filled<double>(number);
    }

   private:
    PyObject *at(std::size_t row) const { return PyTuple_GET_ITEM(PyList_GET_ITEM(rows_.ptr(), row), field_); }

    template <typename T, typename Value>
    nb::object filled(Value value) const {
        auto data = std::make_unique_for_overwrite<T[]>(count_);
        for (std::size_t row = 0; row < count_; ++row) data[row] = value(at(row));
        return array(std::move(data), {count_});
    }

    nb::object of_tuples(std::size_t width) const {
        auto data = std::make_unique_for_overwrite<double[]>(count_ * width);
        for (std::size_t row = 0; row < count_; ++row) {
            PyObject *const tuple = at(row);
            if (!PyTuple_Check(tuple) || static_cast<std::size_t>(PyTuple_GET_SIZE(tuple)) != width) {
                throw nb::value_error("a field is not equally long in all samples");
            }
            for (std::size_t k = 0; k < width; ++k) data[row * width + k] = number(PyTuple_GET_ITEM(tuple, k));
        }
        return array(std::move(data), {count_, width});
    }

    nb::list rows_;
    std::size_t count_;
    Py_ssize_t field_;
};

nb::list sample_columns(nb::list rows) {
    nb::list columns;
    if (!rows.size()) throw nb::value_error("no samples");
    const Py_ssize_t fields = PyTuple_Check(rows[0].ptr()) ? PyTuple_GET_SIZE(rows[0].ptr()) : 0;
    for (nb::handle row : rows) {
        if (!PyTuple_Check(row.ptr()) || PyTuple_GET_SIZE(row.ptr()) != fields) {
            throw nb::value_error("samples are tuples, all of one length");
        }
    }
    for (Py_ssize_t field = 0; field < fields; ++field) columns.append(Column(rows, field).made());
    return columns;
}

}  // namespace

void bind_sample_columns(nb::module_ &m) {
    m.def("sample_columns", sample_columns, "rows"_a,
          "Samples of one type (tuples, at least one) as one array per field: bool, int64 or float64 of shape (n), as "
          "numpy would choose; float64 of shape (n, k) for tuples of k numbers.");
}
