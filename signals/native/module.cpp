// nanobind entry point of signals._kernel: the functions of this folder's headers for Python code that feeds state.
#include <nanobind/nanobind.h>

#include <array>
#include <stdexcept>
#include <tuple>

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include "crash_guard.hpp"
#include "detmath.hpp"
#include "geodesy.hpp"
#include "noise_stream.hpp"
#include "rotation.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Three = std::tuple<double, double, double>;
using Four = std::tuple<double, double, double, double>;

template <void (*kRotate)(const double *, const double *, double *)>
Three rotated(const Four &q, const Three &v) {
    const double quaternion[4] = {std::get<0>(q), std::get<1>(q), std::get<2>(q), std::get<3>(q)};
    const double vector[3] = {std::get<0>(v), std::get<1>(v), std::get<2>(v)};
    double out[3];
    kRotate(quaternion, vector, out);
    return {out[0], out[1], out[2]};
}

Three euler(const Four &q) {
    const hil::Vec3 angles = hil::euler_of({std::get<0>(q), std::get<1>(q), std::get<2>(q), std::get<3>(q)});
    return {angles.x, angles.y, angles.z};
}

Four quaternion_of_axes(const Three &x, const Three &y, const Three &z) {
    const auto vector = [](const Three &v) { return hil::Vec3{std::get<0>(v), std::get<1>(v), std::get<2>(v)}; };
    const hil::Quat q = hil::from_axes(vector(x), vector(y), vector(z));
    return {q.w, q.x, q.y, q.z};
}

Three tangent_ned(const Three &origin, const Three &place) {
    hil::LocalTangentPlane plane;
    plane.set_origin({std::get<0>(origin), std::get<1>(origin), std::get<2>(origin)});
    const hil::Vec3 p_N = plane.to_ned({std::get<0>(place), std::get<1>(place), std::get<2>(place)});
    return {p_N.x, p_N.y, p_N.z};
}

using Key = std::array<std::uint64_t, 2>;
using Values = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void normals_from_uniforms(const Values &p, const Out &out) {
    if (out.shape(0) != p.shape(0)) throw std::invalid_argument("out must be as long as p");
    for (std::size_t i = 0; i < p.shape(0); ++i) out.data()[i] = hil::normal_from_uniform(p.data()[i]);
}

nb::tuple normal(hil::NoiseStream &stream, std::uint64_t index) {
    const double *values = stream.normal(index);
    PyObject *result = PyTuple_New(static_cast<Py_ssize_t>(stream.lanes()));
    for (std::size_t i = 0; i < stream.lanes(); ++i) {
        PyTuple_SetItem(result, static_cast<Py_ssize_t>(i), PyFloat_FromDouble(values[i]));
    }
    return nb::steal<nb::tuple>(result);
}

}  // namespace

void bind_samples(nb::module_ &m);

NB_MODULE(_kernel, m) {
    m.doc() = "Elementary functions, rotations and geodesy: the same bits on every machine; samples as arrays.";
    m.def("det_sin", &hil::det::sin, "x_rad"_a);
    m.def("det_cos", &hil::det::cos, "x_rad"_a);
    m.def("det_exp", &hil::det::exp, "x"_a);
    m.def("det_log", &hil::det::log, "x"_a);
    m.def("det_pow", &hil::det::pow, "x"_a, "y"_a);
    m.def("det_atan2", &hil::det::atan2, "y"_a, "x"_a);
    m.def("det_asin", &hil::det::asin, "x"_a);
    m.def("normals_from_uniforms", &normals_from_uniforms, "p"_a.noconvert(), "out"_a.noconvert(),
          "Write the standard normal quantiles of p, 0 < p < 1, to out (AS 241).");
    nb::class_<hil::NoiseStream>(m, "NoiseGenerator", "Generator of the standard normals of one named source (noise_stream.hpp).")
        .def("__init__",
             [](hil::NoiseStream *self, Key key, std::size_t lanes) {
                 if (lanes < 1) throw std::invalid_argument("a noise stream needs at least one lane");
                 new (self) hil::NoiseStream(key[0], key[1], lanes);
             },
             "key"_a, "lanes"_a)
        .def("normal", &normal, "index"_a, "Return the `lanes` standard normals of a sample.");
    m.def("rotate_into_body", &rotated<hil::rotate_into_body>, "q_WB"_a, "v_W"_a,
          "Return R(q)^T v: the vector v_W in B.");
    m.def("rotate_into_world", &rotated<hil::rotate_into_world>, "q_WB"_a, "v_B"_a,
          "Return R(q) v: the vector v_B in W.");
    m.def("roll_pitch_yaw", &euler, "q"_a, "Return roll, pitch, yaw [rad] of a unit quaternion: yaw first, then pitch, then roll.");
    m.def("quaternion_of_axes", &quaternion_of_axes, "x"_a, "y"_a, "z"_a, "Return the unit quaternion of a frame with these orthonormal axes.");
    m.def("tangent_ned", &tangent_ned, "origin"_a, "place"_a,
          "Return the NED position [m] of a place relative to an origin, both (latitude, longitude [deg], altitude [m]): "
          "north and east are exact on WGS-84, down is the difference of altitudes.");
    m.def("guard_crashes",
          [](int status, const std::string &crashed, const std::string &no_memory) {
              hil::crash_guard::arm(status, {crashed, no_memory});
          },
          "status"_a, "crashed"_a, "no_memory"_a,
          "End with `status` and one of two messages where a native library ends the process (crash_guard.hpp).");
    m.def("unguard_crashes", &hil::crash_guard::disarm, "Leave crashes to the system, in a child process.");
    m.def("guard_end", &hil::crash_guard::end, "status"_a, "Let nothing change the exit status any more.");
    m.def("guard_file",
          [](const std::string &path, const std::string &crashed, const std::string &no_memory) {
              hil::crash_guard::keep(path, {crashed, no_memory});
          },
          "path"_a, "crashed"_a, "no_memory"_a,
          "Write one of two contents to a file when the process crashes; empty contents: leave it.");
    bind_samples(m);
}
