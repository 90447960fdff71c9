// sim._kernels: satellites, their mirror images, and the fix. Contracts: satellite_orbit.hpp, mirror_faces.hpp, gnss_fix.hpp.

#include <cmath>

#include "bind_arrays.hpp"
#include "gnss_fix.hpp"
#include "mirror_faces.hpp"
#include "satellite_orbit.hpp"

namespace {

constexpr std::size_t kOrbitColumns = 10;

void satellite_directions(In<double, -1, 10> orbits, double t_s, const Vec3 &antenna, const std::array<double, 9> &R_WE,
                          Out<double, -1, 3> out) {
    expect_rows(out, orbits.shape(0), "out");
    for (std::size_t s = 0; s < orbits.shape(0); ++s) {
        const double *o = orbits.data() + kOrbitColumns * s;
        double p[3], d[3];
        hil::sim::satellite_position({o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], o[9]}, t_s, p);
        for (int k = 0; k < 3; ++k) p[k] -= antenna[k];
        for (int k = 0; k < 3; ++k) d[k] = R_WE[3 * k] * p[0] + R_WE[3 * k + 1] * p[1] + R_WE[3 * k + 2] * p[2];
        const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        for (int k = 0; k < 3; ++k) out.data()[3 * s + k] = d[k] / length;
    }
}

void satellite_positions(In<double, -1, 10> orbits, double t_s, Out<double, -1, 3> out) {
    expect_rows(out, orbits.shape(0), "out");
    for (std::size_t s = 0; s < orbits.shape(0); ++s) {
        const double *o = orbits.data() + kOrbitColumns * s;
        hil::sim::satellite_position({o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], o[9]}, t_s, out.data() + 3 * s);
    }
}

std::size_t find_mirror_hits(const Vec3 &antenna, In<double, -1, 7> faces, In<double, -1, 3> directions, double reach_m,
                             double max_extra_m,
                             Out<std::int32_t, -1, 2> of, Out<double, -1, 9> what) {
    expect_rows(what, of.shape(0), "what");
    std::vector<hil::sim::MirrorHit> hits(of.shape(0));
    const std::size_t found = hil::sim::mirror_hits(antenna.data(), faces.data(), faces.shape(0), directions.data(),
                                          directions.shape(0), reach_m, max_extra_m, hits.data(), hits.size());
    for (std::size_t i = 0; i < found && i < hits.size(); ++i) {
        of.data()[2 * i] = hits[i].satellite;
        of.data()[2 * i + 1] = hits[i].face;
        double *row = what.data() + 9 * i;
        for (int k = 0; k < 3; ++k) row[k] = hits[i].direction[k], row[3 + k] = hits[i].normal[k];
        row[6] = hits[i].distance_m, row[7] = hits[i].extra_m, row[8] = hits[i].cosine;
    }
    return found;
}

bool above_mask(In<double, -1, 6> boxes, const Vec3 &antenna, double tangent) {
    for (std::size_t b = 0; b < boxes.shape(0); ++b) {
        const double *box = boxes.data() + 6 * b;
        const double rise = box[5] - antenna[2];
        if (rise <= 0.0) continue;
        double away = 0.0;
        for (int k = 0; k < 2; ++k) {
            double off = 0.0;
            if (box[k] > antenna[k]) off = box[k] - antenna[k];
            if (box[3 + k] < antenna[k]) off = antenna[k] - box[3 + k];
            away += off * off;
        }
        if (rise * rise >= tangent * tangent * away) return true;
    }
    return false;
}

nb::tuple solve(In<double, -1, 3> directions, In<double, -1> weights, In<double, -1> errors, Out<double, -1> residuals,
                bool held, double height_error) {
    const std::size_t count = directions.shape(0);
    expect_rows(weights, count, "weights");
    expect_rows(errors, count, "errors");
    expect_rows(residuals, count, "residuals");
    const hil::sim::GnssFix fix = hil::sim::solve_gnss(directions.data(), weights.data(), errors.data(), count, held, height_error,
                                   residuals.data());
    const auto row = [](const double(&v)[4]) { return nb::make_tuple(v[0], v[1], v[2], v[3]); };
    return nb::make_tuple(fix.solved, row(fix.shift), row(fix.variance), row(fix.dilution));
}

}  // namespace

void bind_gnss(nb::module_ &m) {
    m.def("satellite_positions", &satellite_positions, "orbits"_a, "t_s"_a, "out"_a.noconvert(),
          "Write the earth-fixed position [m] of each satellite at GPS time t_s. Columns: satellite_orbit.hpp.");
    m.def("satellite_directions", &satellite_directions, "orbits"_a, "t_s"_a, "antenna"_a, "R_WE"_a, "out"_a.noconvert(),
          "Write the unit vector from an earth-fixed place to each satellite, turned by R_WE.");
    m.def("mirror_hits", &find_mirror_hits, "antenna"_a, "faces"_a, "directions"_a, "reach_m"_a, "max_extra_m"_a, "of"_a.noconvert(),
          "what"_a.noconvert(),
          "Write (satellite, face) and (direction, normal, distance, extra path, cosine) of each mirror image; return "
          "their count, also beyond the rows given.");
    m.def("above_mask", &above_mask, "boxes"_a, "antenna"_a, "tangent"_a,
          "Return True if a box (low x y z, high x y z) may rise above the elevation of this tangent.");
    m.def("solve_gnss", &solve, "directions"_a, "weights"_a, "errors"_a, "residuals"_a.noconvert(), nb::kw_only(),
          "held"_a = false, "height_error"_a = 0.0,
          "Return (solved, shift, variance, dilution), each of east, north, up and clock, and write the residuals.");
}
