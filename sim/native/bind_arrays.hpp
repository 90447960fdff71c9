// Argument types of the bindings of sim._kernels. Arrays are C-contiguous views of CPU memory; a shape of -1 accepts
// any length.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace nb = nanobind;
using namespace nb::literals;

template <class T, int... Shape>
using In = nb::ndarray<const T, nb::numpy, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
template <class T, int... Shape>
using Out = nb::ndarray<T, nb::numpy, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
using Vec3 = std::array<double, 3>;
using Mat3 = std::array<double, 9>;
using Key = std::array<std::uint64_t, 2>;  // key of a noise stream

// Throws std::invalid_argument unless an array has one row per ray.
template <class Array>
void expect_rows(const Array &array, std::size_t rays, const char *what) {
    if (array.shape(0) == rays) return;
    throw std::invalid_argument(std::string(what) + " has " + std::to_string(array.shape(0)) + " rows for " +
                                std::to_string(rays) + " rays");
}

// Throws std::invalid_argument unless two arrays have the same height and width.
template <class A, class B>
void same_size(const A &a, const B &b, const char *what) {
    if (a.shape(0) != b.shape(0) || a.shape(1) != b.shape(1)) {
        throw std::invalid_argument(std::string(what) + " and the picture differ in size");
    }
}

inline double as_double(PyObject *item) {
    const double value = PyFloat_AsDouble(item);
    if (value == -1.0 && PyErr_Occurred()) throw nb::python_error();
    return value;
}

// Converts a tuple of N numbers to an array. Written without nanobind's casters, which would add much to
// the microsecond that a whole call takes.
template <std::size_t N>
void unpack(const nb::tuple &source, double (&out)[N], const char *what) {
    if (source.size() != N) {
        throw std::invalid_argument(std::string(what) + " needs " + std::to_string(N) + " values, not " +
                                    std::to_string(source.size()));
    }
    for (std::size_t i = 0; i < N; ++i) out[i] = as_double(PyTuple_GetItem(source.ptr(), static_cast<Py_ssize_t>(i)));
}

