// sim._kernels.IdealController: ideal_controller.hpp for hil.run.stepped.ideal_controller.

#include "bind_arrays.hpp"
#include "ideal_controller.hpp"

using hil::sim::IdealController;
using hil::sim::kMaxRotors;
using hil::sim::Target;

namespace {

int rotors_of(const In<double, -1, 4> &rows, const char *what) {
    const std::size_t n = rows.shape(0);
    if (n < 1 || n > kMaxRotors) throw std::invalid_argument(std::string(what) + " needs a row for each of 1 to 8 rotors");
    return static_cast<int>(n);
}

hil::sim::Allocation allocation_of(const In<double, -1, 4> &mix, Vec3 limits_n) {
    hil::sim::Allocation a{};
    a.rotors = rotors_of(mix, "mix");
    for (int i = 0; i < a.rotors; ++i) {
        for (int j = 0; j < 4; ++j) a.mix[i][j] = mix.data()[4 * i + j];
    }
    a.least_n = limits_n[0];
    a.most_n = limits_n[1];
    a.raised_n = limits_n[2];
    return a;
}

nb::tuple tuple_of(const double *values, int count) {
    nb::object out = nb::steal(PyTuple_New(count));
    for (int i = 0; i < count; ++i) PyTuple_SetItem(out.ptr(), i, PyFloat_FromDouble(values[i]));
    return nb::cast<nb::tuple>(out);
}

nb::tuple commands(IdealController &self, nb::tuple p_WB, nb::tuple q_WB, nb::tuple v_WB_W, nb::tuple w_WB_B,
                   nb::tuple a_WB_W, nb::tuple alpha_WB_B, nb::tuple rotor_speed_radps, bool in_contact) {
    const int n = self.params.allocation.rotors;
    double p[3], q[4], v[3], w[3], a[3], alpha[3], speed[kMaxRotors], out[kMaxRotors];
    unpack(p_WB, p, "p_WB");
    unpack(q_WB, q, "q_WB");
    unpack(v_WB_W, v, "v_WB_W");
    unpack(w_WB_B, w, "w_WB_B");
    unpack(a_WB_W, a, "a_WB_W");
    unpack(alpha_WB_B, alpha, "alpha_WB_B");
    if (static_cast<int>(rotor_speed_radps.size()) != n) throw std::invalid_argument("rotor_speed_radps needs a value for each rotor");
    for (int i = 0; i < n; ++i) speed[i] = as_double(PyTuple_GetItem(rotor_speed_radps.ptr(), i));
    self.step({p, q, v, w, a, alpha, speed, in_contact}, out);
    return tuple_of(out, n);
}

}  // namespace

void bind_ideal_controller(nb::module_ &m) {
    nb::class_<IdealController>(m, "IdealController",
                                "Ideal flight controller of one multirotor. See hil/run/stepped/ideal_controller.py.")
        .def(
            "__init__",
            [](IdealController *self, In<double, -1, 4> mix, Vec3 limits_n, In<double, -1, 4> columns,
               In<double, -1> reaction, std::array<double, 6> body, Vec3 rotor, Vec3 bounds,
               std::array<double, 6> filters) {
                hil::sim::ControllerParams c{};
                c.allocation = allocation_of(mix, limits_n);
                const int n = c.allocation.rotors;
                if (rotors_of(columns, "columns") != n || reaction.shape(0) != static_cast<std::size_t>(n)) {
                    throw std::invalid_argument("mix, columns and reaction must have the same length");
                }
                for (int i = 0; i < n; ++i) {
                    for (int j = 0; j < 4; ++j) c.columns[i][j] = columns.data()[4 * i + j];
                    c.reaction_nm_per_radps[i] = reaction.data()[i];
                }
                c.mass_kg = body[0];
                for (int j = 0; j < 3; ++j) c.inertia_kgm2[j] = body[1 + j];
                c.gravity_mps2 = body[4];
                c.dt_s = body[5];
                c.thrust_coefficient = rotor[0];
                c.max_speed_radps = rotor[1];
                c.curve = rotor[2];
                c.hover_n = bounds[0];
                c.most_thrust_n = bounds[1];
                c.most_yaw_accel = bounds[2];
                c.lead_up = filters[0];
                c.lead_down = filters[1];
                c.decay_up = filters[2];
                c.decay_down = filters[3];
                c.fade = filters[4];
                c.yaw_share = filters[5];
                new (self) IdealController();
                self->params = c;
                self->reset();
            },
            nb::kw_only(), "mix"_a.noconvert(), "limits_n"_a, "columns"_a.noconvert(), "reaction"_a.noconvert(),
            "body"_a, "rotor"_a, "bounds"_a, "filters"_a,
            "limits_n: least, most thrust of a rotor, collective thrust that torques may raise. body: mass, inertia "
            "x y z, gravity, tick [s]. rotor: thrust coefficient, most speed, thrust model factor. bounds: hover thrust "
            "of a rotor, most collective thrust, most yaw acceleration. filters: lead up, down, decay up, down, fade, "
            "share of yaw.")
        .def(
            "set_gains",
            [](IdealController &self, Vec3 position, Vec3 velocity, Vec3 attitude, Vec3 rate) {
                for (int j = 0; j < 3; ++j) {
                    self.gains.position[j] = position[j];
                    self.gains.velocity[j] = velocity[j];
                    self.gains.attitude[j] = attitude[j];
                    self.gains.rate[j] = rate[j];
                }
            },
            "position"_a, "velocity"_a, "attitude"_a, "rate"_a, "Set the gains of the four loops.")
        .def("reset", &IdealController::reset, "Forget the past.")
        .def(
            "aim",
            [](IdealController &self, int level, double a, double b, int height, double value, bool turns, double yaw,
               double speed_limit_mps) {
                if (level < 0 || level > 3 || height < 0 || height > 2) throw std::invalid_argument("no such set-point");
                Target &t = self.target;
                t.level = static_cast<Target::Level>(level);
                t.level_value[0] = a;
                t.level_value[1] = b;
                t.height = static_cast<Target::Height>(height);
                t.height_value = value;
                t.turns = turns;
                t.yaw_value = yaw;
                t.speed_limit_mps = speed_limit_mps;
            },
            "level"_a, "a"_a, "b"_a, "height"_a, "value"_a, "turns"_a, "yaw"_a, "speed_limit_mps"_a,
            "Set the set-point. level: 0 position, 1 velocity, 2 roll and pitch, 3 their rates; height: 0 height, "
            "1 climb, 2 thrust ratio; turns: yaw is a rate.")
        .def(
            "aim_rotors",
            [](IdealController &self, const std::vector<double> &rotors) {
                if (static_cast<int>(rotors.size()) < self.params.allocation.rotors) {
                    throw std::invalid_argument("a set-point needs a command for each rotor");
                }
                self.target.level = Target::kRotors;
                for (int i = 0; i < self.params.allocation.rotors; ++i) self.target.rotors[i] = rotors[i];
            },
            "rotors"_a, "Set commands of the rotors as the set-point.")
        .def_prop_ro("press", &IdealController::press, "Share of the weight that is left to the ground.")
        .def("commands", &commands, "p_WB"_a, "q_WB"_a, "v_WB_W"_a, "w_WB_B"_a, "a_WB_W"_a, "alpha_WB_B"_a,
             "rotor_speed_radps"_a, "in_contact"_a, "Return the command 0..1 of every rotor until the next tick.");

    m.def(
        "allocate",
        [](In<double, -1, 4> mix, Vec3 limits_n, std::array<double, 4> wanted) {
            const hil::sim::Allocation a = allocation_of(mix, limits_n);
            double out[kMaxRotors];
            hil::sim::allocate(a, wanted.data(), out);
            return tuple_of(out, a.rotors);
        },
        "mix"_a.noconvert(), "limits_n"_a, "wanted"_a,
        "Return the thrust of every rotor for torques about x, y, z and a collective thrust. See allocation.py.");
}
