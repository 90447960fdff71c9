// sim._kernels.RigidBody: the rigid-body kernel bound to arrays that Python owns.
//
// The arrays are handed over once, at construction, and kept alive; a tick then costs one call without array
// arguments. Calls last about a microsecond, so the GIL is kept.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "clearance.hpp"
#include "rigid_body.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using hil::sim::kMaxRotors;
using hil::sim::kPoseVelocity;

namespace {

using Vector = nb::ndarray<double, nb::numpy, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Boxes = nb::ndarray<const double, nb::numpy, nb::shape<-1, 6>, nb::c_contig, nb::device::cpu>;
using Vec3 = std::array<double, 3>;

double as_double(PyObject *item) {
    const double value = PyFloat_AsDouble(item);
    if (value == -1.0 && PyErr_Occurred()) throw nb::python_error();
    return value;
}

template <int N>
void unpack(nb::tuple source, double *out, const char *what) {
    if (source.size() != N) {
        throw std::invalid_argument(std::string(what) + " needs " + std::to_string(N) + " values, not " +
                                    std::to_string(source.size()));
    }
    for (int i = 0; i < N; ++i) out[i] = as_double(PyTuple_GET_ITEM(source.ptr(), i));
}

class RigidBody {
  public:
    RigidBody(Vector truth, double mass_kg, Vec3 inertia_kgm2, std::vector<Vec3> rotor_position_m,
              std::vector<double> rotor_spin, double thrust_coefficient_n_per_radps2, double moment_ratio_m,
              double max_speed_radps, double time_constant_up_s, double time_constant_down_s,
              double rotor_inertia_kgm2, double rotor_drag_kg_per_rad, Vec3 body_drag_linear_n_per_mps,
              Vec3 body_drag_quadratic_n_per_m2ps2, double gravity_mps2, Vec3 wind_W_mps, double tick_s, int substeps,
              int contact_substeps)
        : truth_(truth), substeps_(substeps), contact_substeps_(contact_substeps), tick_s_(tick_s) {
        const std::size_t n = rotor_position_m.size();
        if (n < 1 || n > kMaxRotors || rotor_spin.size() != n) {
            throw std::invalid_argument("a rigid body needs 1 to 8 rotors, each with a position and a spin");
        }
        if (truth.shape(0) != kPoseVelocity + n + 6) {
            throw std::invalid_argument("truth must hold 13 + rotors + 6 values");
        }
        if (!(tick_s > 0.0) || substeps < 1 || contact_substeps < 1) {
            throw std::invalid_argument("tick and sub-step counts must be above zero");
        }
        params_.mass_kg = mass_kg;
        params_.rotor_count = static_cast<int>(n);
        for (std::size_t i = 0; i < n; ++i) {
            params_.rotor_spin[i] = rotor_spin[i];
            for (int j = 0; j < 3; ++j) params_.rotor_position_m[i][j] = rotor_position_m[i][j];
        }
        params_.thrust_coefficient_n_per_radps2 = thrust_coefficient_n_per_radps2;
        params_.moment_ratio_m = moment_ratio_m;
        params_.max_speed_radps = max_speed_radps;
        params_.time_constant_up_s = time_constant_up_s;
        params_.time_constant_down_s = time_constant_down_s;
        params_.rotor_inertia_kgm2 = rotor_inertia_kgm2;
        params_.rotor_drag_kg_per_rad = rotor_drag_kg_per_rad;
        for (int j = 0; j < 3; ++j) {
            params_.inertia_kgm2[j] = inertia_kgm2[j];
            params_.body_drag_linear_n_per_mps[j] = body_drag_linear_n_per_mps[j];
            params_.body_drag_quadratic_n_per_m2ps2[j] = body_drag_quadratic_n_per_m2ps2[j];
            params_.wind_W_mps[j] = wind_W_mps[j];
        }
        params_.gravity_mps2 = gravity_mps2;
        half_substep_ = hil::sim::rotor_decay(params_, 0.5 * tick_s / substeps);
        contact_substep_ = hil::sim::rotor_decay(params_, tick_s / contact_substeps);
        path_.resize(7 * static_cast<std::size_t>(substeps));
        before_.resize(kPoseVelocity + n);
        remember();
    }

    // Latches this tick's commands. Returns -1, or the index of the first value that is not finite.
    int command(nb::handle controls) {
        PyObject *fast = PySequence_Fast(controls.ptr(), "controls must be a sequence of numbers");
        if (!fast) throw nb::python_error();
        const nb::object keep = nb::steal(fast);
        if (PySequence_Fast_GET_SIZE(fast) < params_.rotor_count) {
            throw std::invalid_argument("fewer controls than rotors");
        }
        for (int i = 0; i < params_.rotor_count; ++i) {
            control_[i] = as_double(PySequence_Fast_GET_ITEM(fast, i));
            if (!std::isfinite(control_[i])) return i;
        }
        return -1;
    }

    double fly() {
        remember();
        return hil::sim::free_flight_tick(params_, half_substep_, tick_s_ / substeps_, substeps_, control_, state(),
                                          path_.data());
    }

    void rewind() {
        for (std::size_t k = 0; k < before_.size(); ++k) state()[k] = before_[k];
    }

    // Mean accelerations over the tick; returns the range code.
    int finish() {
        double *mean = state() + before_.size();
        const double *s = state();
        for (int j = 0; j < 6; ++j) mean[j] = (s[7 + j] - before_[7 + j]) / tick_s_;
        return range_violation();
    }

    double clearance_before(double radius_m, const Boxes &boxes) const {
        return hil::sim::clearance(before_.data(), radius_m, boxes.data(), boxes.shape(0));
    }

    void attach(Vector qpos, Vector qvel, Vector qfrc_applied, Vector qacc) {
        if (qpos.shape(0) != 7 || qvel.shape(0) != 6 || qfrc_applied.shape(0) != 6 || qacc.shape(0) != 6) {
            throw std::invalid_argument("the MuJoCo model must have one free joint and nothing else that moves");
        }
        qpos_ = qpos;
        qvel_ = qvel;
        qfrc_applied_ = qfrc_applied;
        qacc_ = qacc;
    }

    void pose_after_substep(int substep) {
        if (substep < 0 || substep >= substeps_) throw nb::index_error("no such sub-step");
        for (int k = 0; k < 7; ++k) qpos_.data()[k] = path_[7 * static_cast<std::size_t>(substep) + k];
    }

    void contact_load() {
        const double *s = state();
        for (int k = 0; k < 7; ++k) qpos_.data()[k] = s[k];
        for (int k = 0; k < 6; ++k) qvel_.data()[k] = s[7 + k];
        const auto wrench = hil::sim::contact_wrench(params_, contact_substep_, contact_substep_s(), control_, s);
        hil::sim::rotate_into_world(s + 3, wrench.force_B, qfrc_applied_.data());
        for (int k = 0; k < 3; ++k) qfrc_applied_.data()[3 + k] = wrench.torque_B[k];
    }

    void contact_update() {
        hil::sim::contact_update(params_, contact_substep_, contact_substep_s(), control_, qacc_.data(), state());
    }

  private:
    double *state() { return truth_.data(); }
    const double *state() const { return truth_.data(); }
    double contact_substep_s() const { return tick_s_ / contact_substeps_; }
    void remember() {
        for (std::size_t k = 0; k < before_.size(); ++k) before_[k] = state()[k];
    }

    // 0 in range; else which limit: 1 not finite, 2 speed, 3 body rate, 4 position.
    int range_violation() const {
        const double *s = state();
        const std::size_t n = before_.size() + 6;
        for (std::size_t k = 0; k < n; ++k) {
            if (!std::isfinite(s[k])) return 1;
        }
        if (s[7] * s[7] + s[8] * s[8] + s[9] * s[9] > 200.0 * 200.0) return 2;
        if (s[10] * s[10] + s[11] * s[11] + s[12] * s[12] > 200.0 * 200.0) return 3;
        if (s[0] * s[0] + s[1] * s[1] + s[2] * s[2] > 50.0e3 * 50.0e3) return 4;
        return 0;
    }

    hil::sim::RigidBodyParams params_{};
    Vector truth_, qpos_, qvel_, qfrc_applied_, qacc_;
    std::vector<double> path_, before_;
    double control_[kMaxRotors] = {};
    hil::sim::RotorDecay half_substep_{}, contact_substep_{};
    int substeps_, contact_substeps_;
    double tick_s_;
};

}  // namespace

void bind_rigid_body(nb::module_ &m) {
    nb::class_<RigidBody>(m, "RigidBody",
                          "Multirotor rigid body on a caller-owned float64 array `truth`: p_WB[3], q_WB[4] (w-x-y-z), "
                          "v_WB_W[3], w_WB_B[3], rotor speed[n], then mean acceleration in W[3] and mean angular "
                          "acceleration in B[3] over the last tick. SI, ENU/FLU. See rigid_body.hpp.")
        .def(nb::init<Vector, double, Vec3, std::vector<Vec3>, std::vector<double>, double, double, double, double,
                      double, double, double, Vec3, Vec3, double, Vec3, double, int, int>(),
             nb::kw_only(), "truth"_a.noconvert(), "mass_kg"_a, "inertia_kgm2"_a, "rotor_position_m"_a, "rotor_spin"_a,
             "thrust_coefficient_n_per_radps2"_a, "moment_ratio_m"_a, "max_speed_radps"_a, "time_constant_up_s"_a,
             "time_constant_down_s"_a, "rotor_inertia_kgm2"_a, "rotor_drag_kg_per_rad"_a,
             "body_drag_linear_n_per_mps"_a, "body_drag_quadratic_n_per_m2ps2"_a, "gravity_mps2"_a, "wind_W_mps"_a,
             "tick_s"_a, "substeps"_a, "contact_substeps"_a)
        .def("command", &RigidBody::command, "controls"_a,
             "Latch the commands of the coming tick (0..1, saturated). Returns -1, or the first index not finite.")
        .def("fly", &RigidBody::fly, "One tick of free flight. Returns the distance travelled [m].")
        .def("rewind", &RigidBody::rewind, "Back to the state before the last fly().")
        .def("finish", &RigidBody::finish,
             "Write mean accelerations of the tick. Returns 0, or 1 not finite, 2 speed, 3 body rate, 4 position.")
        .def("clearance_before", &RigidBody::clearance_before, "radius_m"_a, "boxes"_a.noconvert(),
             "Lower bound of the gap to the scene at the state before the last fly() [m].")
        .def("attach", &RigidBody::attach, "qpos"_a.noconvert(), "qvel"_a.noconvert(), "qfrc_applied"_a.noconvert(),
             "qacc"_a.noconvert(), "MuJoCo's arrays, for contact.")
        .def("pose_after_substep", &RigidBody::pose_after_substep, "substep"_a, "Write that pose of fly() into qpos.")
        .def("contact_load", &RigidBody::contact_load, "State into qpos, qvel; rotor and air wrench into qfrc_applied.")
        .def("contact_update", &RigidBody::contact_update, "One semi-implicit Euler step with qacc.");

    m.def(
        "rotate_into_body",
        [](nb::tuple q_WB, nb::tuple v_W) {
            double q[4], v[3], out[3];
            unpack<4>(q_WB, q, "q_WB");
            unpack<3>(v_W, v, "v_W");
            hil::sim::rotate_into_body(q, v, out);
            return nb::make_tuple(out[0], out[1], out[2]);
        },
        "q_WB"_a, "v_W"_a, "R(q)^T v: a vector given in W, in B.");
    m.def(
        "ideal_imu",
        [](nb::tuple q_WB, nb::tuple a_WB_W, nb::tuple w_WB_B, nb::tuple alpha_WB_B, double dt_s, double gravity_mps2) {
            double q[4], a[3], w[3], alpha[3], out[6];
            unpack<4>(q_WB, q, "q_WB");
            unpack<3>(a_WB_W, a, "a_WB_W");
            unpack<3>(w_WB_B, w, "w_WB_B");
            unpack<3>(alpha_WB_B, alpha, "alpha_WB_B");
            hil::sim::ideal_imu(q, a, w, alpha, dt_s, gravity_mps2, out);
            return nb::make_tuple(out[0], out[1], out[2], out[3], out[4], out[5]);
        },
        "q_WB"_a, "a_WB_W"_a, "w_WB_B"_a, "alpha_WB_B"_a, "dt_s"_a, "gravity_mps2"_a,
        "Mean specific force [m/s2] and mean rate [rad/s] in B over the step just taken: (fx, fy, fz, gx, gy, gz).");
}
