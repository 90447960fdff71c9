// Search for mirrors among rays on a grid of cells, and their reflection: the inner loops of sim/radar/ghost_echoes.py.
//
// Vectors of n rays are three rows of n: x, y, z. A grid of coarse cells covers 9 fine ones each; row c of `around` holds
// the eight neighbours of coarse cell c, -1 where the grid has none. Geom -1 is no hit; `mirror_at`, `flat_at` and
// `surface_of` have one more element for it. Equations and their sources: sim/radar/bistatic.py.
//
// Determinism: + - * / sqrt of single elements in the order written. Caller-owned arrays; `in_plane` alone allocates,
// an index of the cells.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hil::sim::radar {

constexpr int kGammaSteps = 1024;  // nodes of |Gamma|^2 over the root of the cosine, and one more
constexpr int kDecaySteps = 128;   // nodes of exp(-x) in a unit of x
constexpr int kDecayReach = 60;    // beyond it exp(-x) is that of 60

// Tables of surfaces at a carrier: gamma2 (surfaces, kGammaSteps + 2), phase_height (surfaces) = 4 pi h / lambda, and decay
// (kDecaySteps kDecayReach + 3).
struct MirrorTables {
    const double *gamma2, *phase_height, *decay;
    double slope2;  // 2 s^2
};

struct SurfaceRays {
    std::size_t count;
    const std::int64_t *geom;
    const double *normal, *way_W;  // rows
};

struct MirrorSurfaces {
    const std::uint8_t *mirror_at;    // by geom
    const std::int64_t *surface_of;
    double floor;  // of power times share
};

// g^2 of `count` surfaces at cosines.
void mirror_powers(const MirrorTables &tables, const std::int64_t *surface, const double *cosine, std::size_t count,
                   double *out);
// g^2 of what rays meet; 0 for what is no mirror, or whose g^2 times `share` (the antenna's gain) is below the floor.
void ray_mirror_powers(const MirrorTables &tables, const MirrorSurfaces &surfaces, const SurfaceRays &rays,
                       const double *share, double *out);
// Bistatic sigma0 of `count` surfaces. cosine: rows in, out, beta, local.
void bistatic_sigma0(const MirrorTables &tables, const std::int64_t *surface, const double *cosine, std::size_t count,
                     double *out);

// Coarse cells with a mirror (power > 0) in them or beside them into `near`, their count returned. `within` is 1 where all
// neighbours show the same flat geom and its normal: there is no edge of the mirror nearby.
std::size_t cells_near_mirrors(const SurfaceRays &coarse, const double *power, const std::uint8_t *flat_at,
                               const std::int64_t *around, std::int64_t *near, std::uint8_t *within);

// The nine rays of each cell of `near`: their directions, and where `within` the plane that the coarse ray met, `range_m`
// away from the radar. `assumed` is 1 there.
struct FineRays {
    double *way_W;    // rows of 9 near
    double *range_m;  // 0 where not assumed
    std::int64_t *geom;
    double *normal;
    std::uint8_t *assumed;
};
void fine_rays(const SurfaceRays &coarse, const double *range_m, const std::int64_t *near, std::size_t near_count,
               const std::uint8_t *within, const double *fine_R, const double *axes, const FineRays &out);

// 1 for each of the rays `some` that has two or more of its eight neighbours in the plane that it meets.
void in_plane(const std::int64_t *cell, const SurfaceRays &rays, const double *range_m, const std::int64_t *some,
              std::size_t some_count, std::uint8_t *out);

}  // namespace hil::sim::radar
