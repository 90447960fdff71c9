// sim._kernels.MirrorSearch: mirrors among rays on a grid, with the tables of one world at one carrier. Contract:
// sim/native/radar/mirror_search.hpp. Compiled alone: no group of CMakeLists.txt has it, for in one unit with the other
// bindings of radars GCC 12 does not come to an end.
#include <cmath>

#include "bind_arrays.hpp"
#include "radar/mirror_search.hpp"

namespace rd = hil::sim::radar;

namespace {

using Rows = In<double, 3, -1>;
using Ids = In<std::int64_t, -1>;

void need_mirrors(bool holds, const char *message) {
    if (!holds) throw std::invalid_argument(message);
}

// Reflection of surfaces, by their numbers.
class MirrorTable {
  public:
    MirrorTable(In<double, -1, rd::kGammaSteps + 2> gamma2, In<double, -1> phase_height, In<double, -1> decay, double slope2)
        : gamma2_(gamma2.data(), gamma2.data() + gamma2.size()),
          phase_height_(phase_height.data(), phase_height.data() + phase_height.size()),
          decay_(decay.data(), decay.data() + decay.size()),
          slope2_(slope2) {
        need_mirrors(gamma2.shape(0) == phase_height.shape(0), "gamma2 and phase_height need one row per surface");
        need_mirrors(decay.shape(0) == rd::kDecaySteps * rd::kDecayReach + 3, "decay has the wrong length");
    }

    rd::MirrorTables view() const { return {gamma2_.data(), phase_height_.data(), decay_.data(), slope2_}; }
    std::size_t surfaces() const { return phase_height_.size(); }

    void expect_surfaces(const std::int64_t *ids, std::size_t count) const {
        const auto n = static_cast<std::int64_t>(surfaces());
        for (std::size_t i = 0; i < count; ++i) need_mirrors(ids[i] >= 0 && ids[i] < n, "no such surface");
    }

  private:
    std::vector<double> gamma2_, phase_height_, decay_;
    double slope2_;
};

// The same, of what rays meet. Geoms have -1 for no hit.
class MirrorSearch {
  public:
    MirrorSearch(const MirrorTable &table, Ids surface, In<std::uint8_t, -1> mirror, In<std::uint8_t, -1> flat,
                 In<std::int64_t, -1, 8> around, Rows fine_R, double floor)
        : table_(table),
          surface_(surface.data(), surface.data() + surface.size()),
          mirror_(mirror.data(), mirror.data() + mirror.size()),
          flat_(flat.data(), flat.data() + flat.size()),
          around_(around.data(), around.data() + around.size()),
          fine_R_(fine_R.data(), fine_R.data() + fine_R.size()),
          floor_(floor) {
        need_mirrors(mirror.shape(0) == surface.shape(0) && flat.shape(0) == surface.shape(0), "arrays need one row per geom");
        need_mirrors(fine_R.shape(1) == 9 * around.shape(0), "a coarse cell has nine fine ones");
        table.expect_surfaces(surface_.data(), surface_.size());
        const auto cells = static_cast<std::int64_t>(around.shape(0));
        for (const std::int64_t id : around_) need_mirrors(id >= -1 && id < cells, "around has no such cell");
    }

    void powers(Ids geom, Rows normal, Rows way_W, In<double, -1> share, Out<double, -1> out) const {
        const std::size_t n = geom.shape(0);
        const rd::SurfaceRays rays = rays_of(geom, normal, way_W);
        need_mirrors(share.shape(0) == n && out.shape(0) == n, "arrays need one row per ray");
        const rd::MirrorSurfaces surfaces{mirror_.data(), surface_.data(), floor_};
        nb::gil_scoped_release release;
        rd::ray_mirror_powers(table_.view(), surfaces, rays, share.data(), out.data());
    }

    std::size_t near(Ids geom, Rows normal, Rows way_W, In<double, -1> power, Out<std::int64_t, -1> near,
                     Out<std::uint8_t, -1> within) const {
        const std::size_t n = around_.size() / 8;
        const rd::SurfaceRays rays = rays_of(geom, normal, way_W);
        need_mirrors(geom.shape(0) == n && power.shape(0) == n && near.shape(0) == n && within.shape(0) == n,
                     "arrays need one row per coarse cell");
        nb::gil_scoped_release release;
        return rd::cells_near_mirrors(rays, power.data(), flat_.data(), around_.data(), near.data(), within.data());
    }

    void fine(Ids geom, Rows normal, Rows way_W, In<double, -1> range_m, Ids near, In<std::uint8_t, -1> within,
              In<double, 3, 3> axes, Out<double, 3, -1> fine_way_W, Out<double, -1> fine_range_m, Out<std::int64_t, -1> fine_geom,
              Out<double, 3, -1> fine_normal, Out<std::uint8_t, -1> assumed) const {
        const std::size_t n = around_.size() / 8, m = 9 * near.shape(0);
        const rd::SurfaceRays rays = rays_of(geom, normal, way_W);
        need_mirrors(geom.shape(0) == n && range_m.shape(0) == n && within.shape(0) == n, "arrays need one row per coarse cell");
        need_mirrors(fine_way_W.shape(1) == m && fine_range_m.shape(0) == m && fine_geom.shape(0) == m &&
                         fine_normal.shape(1) == m && assumed.shape(0) == m,
                     "arrays need nine rows per near cell");
        for (std::size_t i = 0; i < near.shape(0); ++i) {
            need_mirrors(near.data()[i] >= 0 && near.data()[i] < static_cast<std::int64_t>(n), "no such coarse cell");
        }
        const rd::FineRays out{fine_way_W.data(), fine_range_m.data(), fine_geom.data(), fine_normal.data(), assumed.data()};
        nb::gil_scoped_release release;
        rd::fine_rays(rays, range_m.data(), near.data(), near.shape(0), within.data(), fine_R_.data(), axes.data(), out);
    }

  private:
    rd::SurfaceRays rays_of(const Ids &geom, const Rows &normal, const Rows &way_W) const {
        const std::size_t n = geom.shape(0);
        need_mirrors(normal.shape(1) == n && way_W.shape(1) == n, "arrays need one row per ray");
        const auto geoms = static_cast<std::int64_t>(surface_.size());
        for (std::size_t i = 0; i < n; ++i) {
            need_mirrors(geom.data()[i] >= -1 && geom.data()[i] < geoms, "no such geom");
        }
        return {n, geom.data(), normal.data(), way_W.data()};
    }

    MirrorTable table_;
    std::vector<std::int64_t> surface_;
    std::vector<std::uint8_t> mirror_, flat_;
    std::vector<std::int64_t> around_;
    std::vector<double> fine_R_;
    double floor_;
};

}  // namespace

void bind_radar_mirrors(nb::module_ &m) {
    m.attr("MIRROR_GAMMA_STEPS") = rd::kGammaSteps;
    m.attr("MIRROR_DECAY_STEPS") = rd::kDecaySteps;
    m.attr("MIRROR_DECAY_REACH") = rd::kDecayReach;
    nb::class_<MirrorTable>(m, "MirrorTable")
        .def(nb::init<In<double, -1, rd::kGammaSteps + 2>, In<double, -1>, In<double, -1>, double>(), "gamma2"_a.noconvert(),
             "phase_height"_a.noconvert(), "decay"_a.noconvert(), "slope2"_a, "Tables of surfaces; see radar/mirror_search.hpp.")
        .def(
            "mirror_powers",
            [](const MirrorTable &self, Ids surface, In<double, -1> cosine, Out<double, -1> out) {
                const std::size_t n = surface.shape(0);
                need_mirrors(cosine.shape(0) == n && out.shape(0) == n, "arrays need one row per surface");
                self.expect_surfaces(surface.data(), n);
                nb::gil_scoped_release release;
                rd::mirror_powers(self.view(), surface.data(), cosine.data(), n, out.data());
            },
            "surface"_a.noconvert(), "cosine"_a.noconvert(), "out"_a.noconvert(), "Write g^2.")
        .def(
            "sigma0",
            [](const MirrorTable &self, Ids surface, In<double, 4, -1> cosine, Out<double, -1> out) {
                const std::size_t n = surface.shape(0);
                need_mirrors(cosine.shape(1) == n && out.shape(0) == n, "arrays need one row per surface");
                self.expect_surfaces(surface.data(), n);
                nb::gil_scoped_release release;
                rd::bistatic_sigma0(self.view(), surface.data(), cosine.data(), n, out.data());
            },
            "surface"_a.noconvert(), "cosine"_a.noconvert(), "out"_a.noconvert(),
            "Write sigma0; rows of cosine: in, out, beta, local.");
    nb::class_<MirrorSearch>(m, "MirrorSearch")
        .def(nb::init<const MirrorTable &, Ids, In<std::uint8_t, -1>, In<std::uint8_t, -1>, In<std::int64_t, -1, 8>, Rows, double>(),
             "table"_a, nb::kw_only(), "surface"_a.noconvert(), "mirror"_a.noconvert(), "flat"_a.noconvert(),
             "around"_a.noconvert(), "fine_R"_a.noconvert(), "floor"_a)
        .def("powers", &MirrorSearch::powers, "geom"_a.noconvert(), "normal"_a.noconvert(), "way_W"_a.noconvert(),
             "share"_a.noconvert(), "out"_a.noconvert(), "Write g^2 of what rays meet; 0 for no mirror, or a weak one.")
        .def("near", &MirrorSearch::near, "geom"_a.noconvert(), "normal"_a.noconvert(), "way_W"_a.noconvert(),
             "power"_a.noconvert(), "near"_a.noconvert(), "within"_a.noconvert(),
             "Write the coarse cells with a mirror in or beside them, and which are within one; return their count.")
        .def("fine", &MirrorSearch::fine, "geom"_a.noconvert(), "normal"_a.noconvert(), "way_W"_a.noconvert(),
             "range_m"_a.noconvert(), "near"_a.noconvert(), "within"_a.noconvert(), "axes"_a.noconvert(),
             "fine_way_W"_a.noconvert(), "fine_range_m"_a.noconvert(), "fine_geom"_a.noconvert(),
             "fine_normal"_a.noconvert(), "assumed"_a.noconvert(),
             "Write the nine rays of each cell of `near`, in the plane of the coarse ray where that is within a mirror.");
    m.def(
        "mirror_in_plane",
        [](In<std::int64_t, -1, 2> cell, Rows normal, Rows way_W, In<double, -1> range_m, Ids some, Out<std::uint8_t, -1> out) {
            const std::size_t n = cell.shape(0);
            need_mirrors(normal.shape(1) == n && way_W.shape(1) == n && range_m.shape(0) == n && n < 0x7fffffff,
                         "arrays need one row per ray");
            need_mirrors(out.shape(0) == some.shape(0), "out needs one row per ray of some");
            for (std::size_t i = 0; i < some.shape(0); ++i) {
                need_mirrors(some.data()[i] >= 0 && some.data()[i] < static_cast<std::int64_t>(n), "no such ray");
            }
            for (std::size_t i = 0; i < cell.size(); ++i) {
                need_mirrors(std::abs(cell.data()[i]) < 4096, "cells reach to +-4095");
            }
            nb::gil_scoped_release release;
            rd::in_plane(cell.data(), {n, nullptr, normal.data(), way_W.data()}, range_m.data(), some.data(), some.shape(0),
                         out.data());
        },
        "cell"_a.noconvert(), "normal"_a.noconvert(), "way_W"_a.noconvert(), "range_m"_a.noconvert(), "some"_a.noconvert(),
        "out"_a.noconvert(), "Write 1 where two or more of the eight neighbours are in the plane that the ray meets.");
}
