#include "mirror_search.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace hil::sim::radar {

namespace {

constexpr double kSameNormal = 1.0 - 1e-5, kSamePlaneM = 5e-3, kLeastCosine = 1e-3, kLeastCosBeta = 0.1;

double reflectance(const MirrorTables &tables, std::int64_t surface, double cosine) {
    const double place = std::sqrt(std::clamp(cosine, 0.0, 1.0)) * kGammaSteps;
    const auto node = static_cast<std::size_t>(place);
    const double *row = tables.gamma2 + static_cast<std::size_t>(surface) * (kGammaSteps + 2) + node;
    return row[0] + (place - static_cast<double>(node)) * (row[1] - row[0]);
}

double decay(const MirrorTables &tables, double x) {
    const double place = std::min(x, static_cast<double>(kDecayReach)) * kDecaySteps;
    const auto node = static_cast<std::size_t>(place);
    const double *at = tables.decay + node;
    return at[0] + (place - static_cast<double>(node)) * (at[1] - at[0]);
}

double mirror_power(const MirrorTables &tables, std::int64_t surface, double cosine) {
    const double phase = tables.phase_height[surface] * cosine;
    return reflectance(tables, surface, cosine) * decay(tables, phase * phase);
}

double dot(const double *a, std::size_t i, std::size_t na, const double *b, std::size_t j, std::size_t nb) {
    return a[i] * b[j] + a[na + i] * b[nb + j] + a[2 * na + i] * b[2 * nb + j];
}

}  // namespace

void mirror_powers(const MirrorTables &tables, const std::int64_t *surface, const double *cosine, std::size_t count,
                   double *out) {
    for (std::size_t i = 0; i < count; ++i) out[i] = mirror_power(tables, surface[i], cosine[i]);
}

void ray_mirror_powers(const MirrorTables &tables, const MirrorSurfaces &surfaces, const SurfaceRays &rays,
                       const double *share, double *out) {
    for (std::size_t i = 0; i < rays.count; ++i) {
        out[i] = 0.0;
        const std::int64_t geom = rays.geom[i];
        if (geom < 0 || !surfaces.mirror_at[geom]) continue;
        const double cosine = -dot(rays.normal, i, rays.count, rays.way_W, i, rays.count);
        const double power = mirror_power(tables, surfaces.surface_of[geom], cosine);
        if (!(power * share[i] < surfaces.floor)) out[i] = power;
    }
}

void bistatic_sigma0(const MirrorTables &tables, const std::int64_t *surface, const double *cosine, std::size_t count,
                     double *out) {
    const double *cos_in = cosine, *cos_out = cosine + count, *cos_beta = cosine + 2 * count, *cos_local = cosine + 3 * count;
    for (std::size_t i = 0; i < count; ++i) {
        const double phase = 0.5 * tables.phase_height[surface[i]] * (cos_in[i] + cos_out[i]);
        const double coherent = decay(tables, phase * phase);
        const double beta = std::max(cos_beta[i], kLeastCosBeta), b2 = beta * beta;
        const double lobe = decay(tables, (1.0 - b2) / (b2 * tables.slope2)) / (tables.slope2 * b2 * b2);
        const double both = reflectance(tables, surface[i], cos_in[i]) * reflectance(tables, surface[i], cos_out[i]);
        const double rough = 4.0 * (1.0 - coherent) * std::sqrt(both) * cos_in[i] * cos_out[i];
        out[i] = coherent * reflectance(tables, surface[i], cos_local[i]) * lobe + rough;
    }
}

std::size_t cells_near_mirrors(const SurfaceRays &coarse, const double *power, const std::uint8_t *flat_at,
                               const std::int64_t *around, std::int64_t *near, std::uint8_t *within) {
    const std::size_t n = coarse.count;
    std::size_t count = 0;
    for (std::size_t c = 0; c < n; ++c) {
        const std::int64_t *row = around + 8 * c;
        const bool shows = power[c] > 0.0;
        bool any = shows, all = shows && flat_at[coarse.geom[c]] != 0;
        for (int k = 0; k < 8; ++k) {
            const auto beside = static_cast<std::size_t>(row[k]);
            const bool shown = row[k] >= 0 && power[beside] > 0.0;
            any = any || shown;
            all = all && shown && coarse.geom[beside] == coarse.geom[c] &&
                  dot(coarse.normal, c, n, coarse.normal, beside, n) > kSameNormal;
        }
        within[c] = all ? 1 : 0;
        if (any) near[count++] = static_cast<std::int64_t>(c);
    }
    return count;
}

void fine_rays(const SurfaceRays &coarse, const double *range_m, const std::int64_t *near, std::size_t near_count,
               const std::uint8_t *within, const double *fine_R, const double *axes, const FineRays &out) {
    const std::size_t n = coarse.count, m = 9 * near_count, fine = 9 * n;
    std::size_t at = 0;
    for (std::size_t k = 0; k < near_count; ++k) {
        const auto c = static_cast<std::size_t>(near[k]);
        const double offset =
            coarse.geom[c] >= 0 ? range_m[c] * dot(coarse.normal, c, n, coarse.way_W, c, n) : 0.0;
        for (std::size_t child = 9 * c; child < 9 * c + 9; ++child, ++at) {
            for (std::size_t w = 0; w < 3; ++w) {
                out.way_W[w * m + at] = fine_R[child] * axes[w] + fine_R[fine + child] * axes[3 + w] +
                                        fine_R[2 * fine + child] * axes[6 + w];
                out.normal[w * m + at] = coarse.normal[w * n + c];
            }
            out.geom[at] = coarse.geom[c];
            const double down = dot(out.normal, at, m, out.way_W, at, m);
            const bool assumed = within[c] != 0 && down < -kLeastCosine;
            out.assumed[at] = assumed ? 1 : 0;
            out.range_m[at] = assumed ? offset / down : 0.0;
        }
    }
}

void in_plane(const std::int64_t *cell, const SurfaceRays &rays, const double *range_m, const std::int64_t *some,
              std::size_t some_count, std::uint8_t *out) {
    const std::size_t n = rays.count;
    if (n == 0) return;
    // Place of each cell in the list, on a grid with one cell more at each rim; -1: not in it.
    std::int64_t first[2] = {cell[0], cell[1]}, last[2] = {cell[0], cell[1]};
    for (std::size_t i = 0; i < n; ++i) {
        for (int axis = 0; axis < 2; ++axis) {
            first[axis] = std::min(first[axis], cell[2 * i + axis]);
            last[axis] = std::max(last[axis], cell[2 * i + axis]);
        }
    }
    const std::int64_t width = last[1] - first[1] + 3;
    const auto place_of = [&](std::size_t i) {
        return static_cast<std::size_t>((cell[2 * i] - first[0] + 1) * width + cell[2 * i + 1] - first[1] + 1);
    };
    std::vector<std::int32_t> index(static_cast<std::size_t>((last[0] - first[0] + 3) * width), -1);
    for (std::size_t i = 0; i < n; ++i) index[place_of(i)] = static_cast<std::int32_t>(i);
    const std::int64_t steps[8] = {-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1};
    const auto reach_m = [&](std::size_t i) { return std::isfinite(range_m[i]) ? range_m[i] : 0.0; };
    for (std::size_t k = 0; k < some_count; ++k) {
        const auto i = static_cast<std::size_t>(some[k]);
        const auto height = [&](std::size_t j) {  // of the point that ray j meets, along the normal of ray i
            const double reach = reach_m(j);
            double sum = rays.normal[i] * (reach * rays.way_W[j]);
            for (std::size_t w = 1; w < 3; ++w) sum += rays.normal[w * n + i] * (reach * rays.way_W[w * n + j]);
            return sum;
        };
        const double own = height(i);
        const std::size_t middle = place_of(i);
        int agree = 0;
        for (const std::int64_t step : steps) {
            const std::int32_t beside = index[static_cast<std::size_t>(static_cast<std::int64_t>(middle) + step)];
            if (beside < 0) continue;
            const auto j = static_cast<std::size_t>(beside);
            if (!(dot(rays.normal, i, n, rays.normal, j, n) > kSameNormal)) continue;
            if (std::fabs(height(j) - own) < kSamePlaneM && ++agree == 2) break;
        }
        out[k] = agree == 2 ? 1 : 0;
    }
}

}  // namespace hil::sim::radar
