// sim._kernels.crc32: zlib.crc32, faster. Contract: crc32.hpp.
#include <nanobind/nanobind.h>

#include <cstdint>

#include "crc32.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

constexpr Py_ssize_t kLong = 1 << 14;  // bytes from which on it pays to let others run

std::uint32_t crc32_of(nb::handle data, std::uint32_t before, bool tables) {
    Py_buffer view;
    if (PyObject_GetBuffer(data.ptr(), &view, PyBUF_SIMPLE) != 0) throw nb::python_error();
    const auto compute = [&] {
        const auto *bytes = static_cast<const std::uint8_t *>(view.buf);
        const auto size = static_cast<std::size_t>(view.len);
        return tables ? hil::sim::crc32_by_tables(bytes, size, before) : hil::sim::crc32(bytes, size, before);
    };
    std::uint32_t found;
    if (view.len < kLong) {
        found = compute();
    } else {
        nb::gil_scoped_release unlocked;
        found = compute();
    }
    PyBuffer_Release(&view);
    return found;
}

}  // namespace

void bind_crc32(nb::module_ &m) {
    m.def("crc32", crc32_of, "data"_a, "before"_a = 0u, "tables"_a = false,
          "CRC-32 of bytes that follow those of CRC `before`; `tables`: without the processor's carry-less product.");
}
