// sim._kernels.WalkPath, Walker and RoadVehicle: what moves along paths. Contracts: walk_path.hpp, gait.hpp,
// road_vehicle.hpp.

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

#include "bind_arrays.hpp"
#include "gait.hpp"
#include "road_vehicle.hpp"
#include "walk_path.hpp"

namespace {

namespace hs = hil::sim;

template <class Row>
constexpr std::size_t kValues = sizeof(Row) / sizeof(double);

template <class Row>
using Rows = In<double, -1, static_cast<int>(kValues<Row>)>;
using LengthValues = std::array<double, kValues<hs::FigureLengths>>;
using ShapeValues = std::array<double, kValues<hs::GaitShape>>;
using PedalValues = std::array<double, kValues<hs::Pedalling>>;
using ThreeRows = std::array<hs::LimbRow, 3>;

template <class Row>
std::vector<Row> rows_of(const Rows<Row> &values) {
    std::vector<Row> rows(values.shape(0));
    if (!rows.empty()) {
        std::memcpy(rows.data(), values.data(), rows.size() * sizeof(Row));
    }
    return rows;
}

}  // namespace

void bind_gait(nb::module_ &m) {
    nb::class_<hs::WalkPath>(m, "WalkPath", "Closed walking path (walk_path.hpp).")
        .def(
            "__init__",
            [](hs::WalkPath *self, const Rows<hs::WalkPiece> &pieces, const Rows<hs::WalkStraight> &straights,
               const Rows<hs::WalkCorner> &corners, double lap_s, double offset_s) {
                new (self) hs::WalkPath(rows_of<hs::WalkPiece>(pieces), rows_of<hs::WalkStraight>(straights),
                                        rows_of<hs::WalkCorner>(corners), lap_s, offset_s);
            },
            nb::kw_only(), "pieces"_a, "straights"_a, "corners"_a, "lap_s"_a, "offset_s"_a)
        .def(
            "progress",
            [](const hs::WalkPath &path, std::int64_t t_ns) {
                const hs::WalkProgress found = path.progress(t_ns);
                return nb::make_tuple(found.laps, found.s_m, found.speed_mps);
            },
            "t_ns"_a, "Return whole laps, metres into the lap, and speed at `t_ns`.")
        .def(
            "place",
            [](const hs::WalkPath &path, double s_m) {
                const hs::WalkPlace p = path.place(s_m);
                return nb::make_tuple(p.x_m, p.y_m, p.cos, p.sin, p.dx_ds, p.dy_ds, p.yaw_per_m);
            },
            "s_m"_a,
            "Return x, y [m], cos and sin of the heading, dx/ds, dy/ds, and heading change per metre, `s_m` into the lap.");

    m.def(
        "fit_gait",
        [](const LengthValues &lengths_m, double speed_mps, double cycle_m) {
            return std::bit_cast<ShapeValues>(
                hs::fit_gait(std::bit_cast<hs::FigureLengths>(lengths_m), speed_mps, cycle_m));
        },
        "lengths_m"_a, "speed_mps"_a, "cycle_m"_a, "Return the values of a GaitShape (gait.hpp).");
    m.def(
        "gait_rows",
        [](const ShapeValues &shape, double phase) {
            hs::LimbRows rows;
            hs::gait_rows(std::bit_cast<hs::GaitShape>(shape), phase, rows);
            return rows;
        },
        "shape"_a, "phase"_a, "Return a row for each limb at `phase` in [0, 1), in the walker's frame H (gait.hpp).");
    m.def(
        "resting_leg",
        [](const LengthValues &lengths_m, double y, double hip_z, double ankle_x, double ankle_z) {
            ThreeRows rows;
            hs::resting_leg(std::bit_cast<hs::FigureLengths>(lengths_m), y, hip_z, ankle_x, ankle_z, rows.data());
            return rows;
        },
        "lengths_m"_a, "y"_a, "hip_z"_a, "ankle_x"_a, "ankle_z"_a, "Return the rows of thigh, shank and foot.");
    m.def(
        "resting_arm",
        [](const LengthValues &lengths_m, double y, double z, double upper_rad, double fore_rad) {
            ThreeRows rows;
            hs::resting_arm(std::bit_cast<hs::FigureLengths>(lengths_m), y, z, upper_rad, fore_rad, rows.data());
            return rows;
        },
        "lengths_m"_a, "y"_a, "z"_a, "upper_rad"_a, "fore_rad"_a, "Return the rows of upper arm, forearm and hand.");

    nb::class_<hs::Walker, hs::Actor>(m, "Walker", "Person who walks on a path (gait.hpp).")
        .def(
            "__init__",
            [](hs::Walker *self, const ShapeValues &shape, const hs::WalkPath &path, double cycles_per_m,
               double ground_m, double bound_z_m, double bound_radius_m) {
                new (self) hs::Walker(std::bit_cast<hs::GaitShape>(shape), path, cycles_per_m, ground_m, bound_z_m,
                                      bound_radius_m);
            },
            nb::kw_only(), "shape"_a, "path"_a, "cycles_per_m"_a, "ground_m"_a, "bound_z_m"_a, "bound_radius_m"_a)
        .def(
            "__init__",
            [](hs::Walker *self, const hs::LimbRows &seated, const hs::WalkPath &path, double ground_m,
               double bound_z_m, double bound_radius_m) {
                new (self) hs::Walker(seated, path, ground_m, bound_z_m, bound_radius_m);
            },
            nb::kw_only(), "seated"_a, "path"_a, "ground_m"_a, "bound_z_m"_a, "bound_radius_m"_a)
        .def(
            "__init__",
            [](hs::Walker *self, const hs::LimbRows &seated, const PedalValues &legs, const hs::WalkPath &path,
               double cycles_per_m, double ground_m, double bound_z_m, double bound_radius_m) {
                new (self) hs::Walker(seated, std::bit_cast<hs::Pedalling>(legs), path, cycles_per_m, ground_m,
                                      bound_z_m, bound_radius_m);
            },
            nb::kw_only(), "seated"_a, "legs"_a, "path"_a, "cycles_per_m"_a, "ground_m"_a, "bound_z_m"_a,
            "bound_radius_m"_a)
        .def("phase", &hs::Walker::phase, "t_ns"_a, "Return the phase of the step cycle or of the cranks, [0, 1).")
        .def(
            "pose",
            [](const hs::Walker &walker, std::int64_t t_ns, Out<double, hs::kLimbs, 3> p_WB, Out<double, hs::kLimbs, 4> q_WB, Out<double, hs::kLimbs, 3> v_WB_W, Out<double, hs::kLimbs, 3> w_WB_W) {
                walker.pose(t_ns, p_WB.data(), q_WB.data(), v_WB_W.data(), w_WB_W.data());
            },
            "t_ns"_a, "p_WB"_a.noconvert(), "q_WB"_a.noconvert(), "v_WB_W"_a.noconvert(), "w_WB_W"_a.noconvert(),
            "Fill poses and velocities in W of all limbs.");
    nb::class_<hs::RoadVehicle, hs::Actor>(m, "RoadVehicle", "Road vehicle on a closed path (road_vehicle.hpp).")
        .def(
            "__init__",
            [](hs::RoadVehicle *self, const hs::WalkPath &path, const Rows<hs::RoadWheel> &wheels_B, double ground_m,
               double bound_z_m, double bound_radius_m) {
                new (self) hs::RoadVehicle(path, rows_of<hs::RoadWheel>(wheels_B), ground_m, bound_z_m, bound_radius_m);
            },
            nb::kw_only(), "path"_a, "wheels_B"_a, "ground_m"_a, "bound_z_m"_a, "bound_radius_m"_a)
        .def(
            "pose",
            [](const hs::RoadVehicle &vehicle, std::int64_t t_ns, Out<double, -1, 3> p_WB, Out<double, -1, 4> q_WB, Out<double, -1, 3> v_WB_W, Out<double, -1, 3> w_WB_W) {
                const std::size_t n = vehicle.bodies();
                if (p_WB.shape(0) != n || q_WB.shape(0) != n || v_WB_W.shape(0) != n || w_WB_W.shape(0) != n) {
                    throw std::invalid_argument("each array needs a row for the chassis and one for each wheel");
                }
                vehicle.pose(t_ns, p_WB.data(), q_WB.data(), v_WB_W.data(), w_WB_W.data());
            },
            "t_ns"_a, "p_WB"_a.noconvert(), "q_WB"_a.noconvert(), "v_WB_W"_a.noconvert(), "w_WB_W"_a.noconvert(),
            "Fill poses and velocities in W of chassis and wheels.");
}
