// sim._kernels.SceneActors, PlacedVehicle, Vicinity, FieldOfView: actors, and regions in which they can affect a sensor.
// Contracts: frame/actors.hpp, placed_vehicle.hpp, frame/reach.hpp.
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "bind_arrays.hpp"
#include "frame/actors.hpp"
#include "placed_vehicle.hpp"

namespace hs = hil::sim;
namespace fr = hil::sim::frame;

namespace {

// Actor that is written in Python.
class PythonActor : public hs::Actor {
public:
    explicit PythonActor(nb::object actor)
        : actor_(std::move(actor)), bodies_(nb::len(nb::object(actor_.attr("bodies")))) {}

    std::size_t bodies() const override { return bodies_; }

    hs::Sphere bound(std::int64_t t_ns) const override {
        const auto [centre_W, radius_m] = nb::cast<std::pair<Vec3, double>>(actor_.attr("bound")(t_ns));
        return {{centre_W[0], centre_W[1], centre_W[2]}, radius_m};
    }

    void pose(std::int64_t t_ns, double *p_WB, double *q_WB, double *v_WB_W, double *w_WB_W) const override {
        actor_.attr("pose")(t_ns, view(p_WB, 3), view(q_WB, 4), view(v_WB_W, 3), view(w_WB_W, 3));
    }

private:
    nb::object view(double *values, std::size_t columns) const {
        return nb::cast(nb::ndarray<nb::numpy, double>(values, {bodies_, columns}, nb::handle()),
                        nb::rv_policy::reference);
    }

    nb::object actor_;
    std::size_t bodies_;
};

std::shared_ptr<const hs::Actor> actor_of(nb::object actor) {
    if (nb::isinstance<hs::Actor>(actor)) {
        return nb::cast<std::shared_ptr<hs::Actor>>(actor);
    }
    return std::make_shared<PythonActor>(std::move(actor));
}

hil::Vec3 vector_of(const nb::tuple &values, const char *what) {
    double v[3];
    unpack(values, v, what);
    return {v[0], v[1], v[2]};
}

}  // namespace

void bind_actors(nb::module_ &m) {
    nb::class_<fr::Reach>(m, "Reach", "Region in which an object can affect a sensor.");
    nb::class_<fr::Vicinity, fr::Reach>(m, "Vicinity", "Points within a range of a box.")
        .def(
            "__init__",
            [](fr::Vicinity *self, const Vec3 &low_W, const Vec3 &high_W, double range_m) {
                new (self) fr::Vicinity(low_W.data(), high_W.data(), range_m);
            },
            "low_W"_a, "high_W"_a, "range_m"_a);
    nb::class_<fr::FieldOfView, fr::Reach>(m, "FieldOfView", "Points that a pinhole camera may see.")
        .def(
            "__init__",
            [](fr::FieldOfView *self, const Vec3 &p_WC, const Mat3 &R_WC, double left, double right, double top,
               double bottom) { new (self) fr::FieldOfView(p_WC.data(), R_WC.data(), left, right, top, bottom); },
            "p_WC"_a, "R_WC"_a, "left"_a, "right"_a, "top"_a, "bottom"_a);
    nb::class_<hs::Actor>(m, "NativeActor", "Moving object whose poses are a pure function of time (actor.hpp).")
        .def(
            "bound",
            [](const hs::Actor &actor, std::int64_t t_ns) {
                const hs::Sphere sphere = actor.bound(t_ns);
                const auto &[x, y, z] = sphere.centre_W;
                return nb::make_tuple(nb::make_tuple(x, y, z), sphere.radius_m);
            },
            "t_ns"_a, "Return centre [m, W] and radius [m] of a sphere that encloses the object at `t_ns`.");
    nb::class_<hs::PlacedVehicle, hs::Actor>(m, "PlacedVehicle", "Vehicle whose states are given from outside (placed_vehicle.hpp).")
        .def(
            "__init__",
            [](hs::PlacedVehicle *self, const std::vector<Vec3> &p_BR, const std::vector<std::array<double, 4>> &q_BR,
               const std::vector<double> &spin, double radius_m) {
                if (q_BR.size() != p_BR.size() || spin.size() != p_BR.size()) {
                    throw std::invalid_argument("positions, attitudes and spins of the rotors must have the same length");
                }
                std::vector<hs::RotorMount> rotors;
                for (std::size_t i = 0; i < p_BR.size(); ++i) {
                    const auto &[x, y, z] = p_BR[i];
                    rotors.push_back({{x, y, z}, {q_BR[i][0], q_BR[i][1], q_BR[i][2], q_BR[i][3]}, spin[i]});
                }
                new (self) hs::PlacedVehicle(std::move(rotors), radius_m);
            },
            nb::kw_only(), "p_BR"_a, "q_BR"_a, "spin"_a, "radius_m"_a)
        .def(
            "place_at",
            [](hs::PlacedVehicle &vehicle, std::int64_t t_ns, const nb::tuple &p_WB, const nb::tuple &q_WB,
               const nb::tuple &v_WB_W, const nb::tuple &w_WB_B, const nb::tuple &speed_radps) {
                double q[4];
                unpack(q_WB, q, "q_WB");
                std::vector<double> speeds(speed_radps.size());
                for (std::size_t i = 0; i < speeds.size(); ++i) {
                    speeds[i] = as_double(PyTuple_GetItem(speed_radps.ptr(), static_cast<Py_ssize_t>(i)));
                }
                vehicle.place({t_ns, vector_of(p_WB, "p_WB"), {q[0], q[1], q[2], q[3]}, vector_of(v_WB_W, "v_WB_W"),
                               vector_of(w_WB_B, "w_WB_B"), std::move(speeds), {}});
            },
            "t_ns"_a, "p_WB"_a, "q_WB"_a, "v_WB_W"_a, "w_WB_B"_a, "speed_radps"_a, "Add the state at `t_ns`.")
        .def(
            "states_since",
            [](const hs::PlacedVehicle &vehicle, std::int64_t t_ns) {
                const std::vector<std::uint8_t> data = vehicle.states_since(t_ns);
                return nb::bytes(data.data(), data.size());
            },
            "t_ns"_a, "Return the state in force at `t_ns` and all later ones, for `restore`; empty without a state.")
        .def(
            "restore",
            [](hs::PlacedVehicle &vehicle, const nb::bytes &states) {
                vehicle.restore(static_cast<const std::uint8_t *>(states.data()), states.size());
            },
            "states"_a, "Replace all states by those that `states_since` of an equal vehicle has returned.")
        .def(
            "pose",
            [](const hs::PlacedVehicle &vehicle, std::int64_t t_ns, Out<double, -1, 3> p_WB, Out<double, -1, 4> q_WB,
               Out<double, -1, 3> v_WB_W, Out<double, -1, 3> w_WB_W) {
                const std::size_t n = vehicle.bodies();
                if (p_WB.shape(0) != n || q_WB.shape(0) != n || v_WB_W.shape(0) != n || w_WB_W.shape(0) != n) {
                    throw std::invalid_argument("each array needs a row for the airframe and one for each rotor");
                }
                vehicle.pose(t_ns, p_WB.data(), q_WB.data(), v_WB_W.data(), w_WB_W.data());
            },
            "t_ns"_a, "p_WB"_a.noconvert(), "q_WB"_a.noconvert(), "v_WB_W"_a.noconvert(), "w_WB_W"_a.noconvert(),
            "Fill poses and velocities in W of the airframe and all rotors.");
    nb::class_<fr::Actors>(m, "SceneActors", "Actors of a geometry, posed where they can affect a sensor.")
        .def(nb::init<fr::Geometry &>(), "geometry"_a, nb::keep_alive<1, 2>())
        .def(
            "add",
            [](fr::Actors &actors, nb::object actor, const In<std::int32_t, -1> &geoms,
               const In<std::int32_t, -1> &bodies, const In<double, -1, 3> &p_BG,
               const In<double, -1, 3, 3> &R_BG) {
                const std::size_t n = geoms.shape(0);
                if (bodies.shape(0) != n || p_BG.shape(0) != n || R_BG.shape(0) != n) {
                    throw std::invalid_argument("geoms, bodies and poses must have the same length");
                }
                std::vector<fr::BodyGeom> on_bodies(n);
                for (std::size_t i = 0; i < n; ++i) {
                    on_bodies[i].geom = geoms.data()[i], on_bodies[i].body = bodies.data()[i];
                    std::copy_n(p_BG.data() + 3 * i, 3, on_bodies[i].p_BG);
                    std::copy_n(R_BG.data() + 9 * i, 9, on_bodies[i].R_BG);
                }
                actors.add(actor_of(std::move(actor)), std::move(on_bodies));
            },
            "actor"_a, "geoms"_a, "bodies"_a, "p_BG"_a, "R_BG"_a, "Add an actor. Geom geoms[i] is fixed to its body bodies[i].")
        .def("leave_out", &fr::Actors::leave_out, "actor"_a, "Leave out one actor, by its number (-1: none).")
        .def("hide", nb::overload_cast<int>(&fr::Actors::hide), "actor"_a, "Hide an actor until it is posed again.")
        .def("pose_within", &fr::Actors::pose_within, "t_ns"_a, "reach"_a.none(), "Pose the actors within reach at `t_ns`; return their number.")
        .def("absent", &fr::Actors::absent, "t_ns"_a, "Return the number of actors that are not posed at `t_ns`.");
}
