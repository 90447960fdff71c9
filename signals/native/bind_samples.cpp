// signals._kernel.sample_columns and TupleReader: samples, which are tuples, to arrays and back.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T>
nb::object array_of(std::unique_ptr<T[]> data, std::initializer_list<std::size_t> shape) {
    T *const values = data.release();
    const nb::capsule owner(values, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(values, shape, owner).cast();
}

// One field of samples, which are tuples of one length. No Python code runs here, so the rows stay as they are.
class Field {
   public:
    Field(const std::vector<PyObject *> &rows, Py_ssize_t index) : rows_(rows), index_(index) {}

    // Returns the field as an array; None if its values are not numbers or tuples of floats.
    nb::object column() const {
        PyObject *const first = at(0);
        if (PyTuple_Check(first)) {
            const Py_ssize_t width = PyTuple_Size(first);
            if (width && !PyFloat_Check(PyTuple_GetItem(first, 0))) return nb::none();
            return of_tuples(static_cast<std::size_t>(width));
        }
        bool truths = true, whole = true, numbers = true;
        for (std::size_t row = 0; row < rows_.size() && numbers; ++row) {
            PyObject *const value = at(row);
            truths = truths && PyBool_Check(value);
            whole = whole && PyLong_CheckExact(value);
            numbers = truths || PyLong_CheckExact(value) || PyFloat_CheckExact(value);
        }
        if (truths) return filled<bool>([](PyObject *value) { return value == Py_True; });
        if (!numbers) return nb::none();
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
    static double number(PyObject *value) {
        const double x = PyFloat_AsDouble(value);
        if (x == -1.0 && PyErr_Occurred()) throw nb::python_error();
        return x;
    }

    PyObject *at(std::size_t row) const { return PyTuple_GetItem(rows_[row], index_); }

    template <class T, class Value>
    nb::object filled(Value value) const {
        auto data = std::make_unique<T[]>(rows_.size());
        for (std::size_t row = 0; row < rows_.size(); ++row) data[row] = value(at(row));
        return array_of(std::move(data), {rows_.size()});
    }

    nb::object of_tuples(std::size_t width) const {
        auto data = std::make_unique<double[]>(rows_.size() * width);
        double *out = data.get();
        for (std::size_t row = 0; row < rows_.size(); ++row) {
            PyObject *const tuple = at(row);
            if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != static_cast<Py_ssize_t>(width)) {
                throw std::invalid_argument("a field is not equally long in all samples");
            }
            for (std::size_t k = 0; k < width; ++k) *out++ = number(PyTuple_GetItem(tuple, static_cast<Py_ssize_t>(k)));
        }
        return array_of(std::move(data), {rows_.size(), width});
    }

    const std::vector<PyObject *> &rows_;
    Py_ssize_t index_;
};

nb::list sample_columns(const nb::list &samples) {
    std::vector<PyObject *> rows;
    rows.reserve(samples.size());
    for (const nb::handle sample : samples) {
        if (!PyTuple_Check(sample.ptr()) || (!rows.empty() && PyTuple_Size(sample.ptr()) != PyTuple_Size(rows[0]))) {
            throw std::invalid_argument("samples are tuples, all of one length");
        }
        rows.push_back(sample.ptr());
    }
    if (rows.empty()) throw std::invalid_argument("there is no sample");
    nb::list columns;
    for (Py_ssize_t index = 0; index < PyTuple_Size(rows[0]); ++index) columns.append(Field(rows, index).column());
    return columns;
}

using Values = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Reads parts of an array as tuples of floats.
class TupleReader {
   public:
    TupleReader(const Values &values, const std::vector<std::pair<std::size_t, std::size_t>> &parts)
        : values_(values), parts_(parts) {
        for (const auto &[begin, end] : parts) {
            if (begin > end || end > values.shape(0)) throw std::invalid_argument("a part is not inside the array");
        }
    }

    nb::object read() const {
        nb::object all = nb::steal(PyTuple_New(static_cast<Py_ssize_t>(parts_.size())));
        for (std::size_t part = 0; part < parts_.size(); ++part) {
            const auto [begin, end] = parts_[part];
            PyObject *const tuple = PyTuple_New(static_cast<Py_ssize_t>(end - begin));
            for (std::size_t i = begin; i < end; ++i) {
                PyTuple_SetItem(tuple, static_cast<Py_ssize_t>(i - begin), PyFloat_FromDouble(values_.data()[i]));
            }
            PyTuple_SetItem(all.ptr(), static_cast<Py_ssize_t>(part), tuple);
        }
        return all;
    }

   private:
    Values values_;
    std::vector<std::pair<std::size_t, std::size_t>> parts_;
};

}  // namespace

void bind_samples(nb::module_ &m) {
    m.def("sample_columns", &sample_columns, "samples"_a,
          "Return samples of one type as one array per field: bool, int64 or float64 of shape (n,), float64 of shape "
          "(n, k) for tuples of k floats; None for a field of anything else.");
    nb::class_<TupleReader>(m, "TupleReader", "Reads parts (begin, end) of an array as tuples of floats.")
        .def(nb::init<const Values &, const std::vector<std::pair<std::size_t, std::size_t>> &>(),
             "values"_a.noconvert(), "parts"_a)
        .def("read", &TupleReader::read, "Return a tuple of floats for each part.");
}
