#include "sky_visibility.hpp"

#include <algorithm>
#include <cmath>

#include "ray_cast.hpp"

namespace hil::sim::frame {
namespace {

constexpr int kDirections = 32;
constexpr double kMostCells = 1e6;
constexpr double kLevel = 0.7;       // least upward component of the normal of ground
constexpr double kAbove_m = 2.0;     // of the grid, over the highest static geom
constexpr double kWidest_m = 500.0;  // from the origin
constexpr std::int32_t kOpen = 255 | 128 << 8 | 128 << 16 | 128 << 24;

struct Direction {
    double w[3];
};

// Fibonacci points on the sphere: z in even steps, each turned by the golden angle. The rotation is multiplied on, so that
// no function of angles is called.
std::vector<Direction> directions() {
    constexpr double kCos = -0.7373688780783197, kSin = 0.6754902942615238;  // of the golden angle, pi (3 - sqrt 5)
    std::vector<Direction> all;
    double c = 1.0, s = 0.0;
    for (int i = 0; i < kDirections; ++i) {
        const double z = 1.0 - (2.0 * i + 1.0) / kDirections, r = std::sqrt(1.0 - z * z);
        all.push_back({{r * c, r * s, z}});
        const double turned = c * kCos - s * kSin;
        s = c * kSin + s * kCos;
        c = turned;
    }
    return all;
}

std::uint32_t byte(double share) { return static_cast<std::uint32_t>(std::clamp(share, 0.0, 1.0) * 255.0 + 0.5); }

struct Sums {
    double a = 0.0, b[3] = {0.0, 0.0, 0.0};
    bool blocked() const { return a < 0.5 / kDirections; }
};

std::int32_t packed(const Sums &sums) {
    std::uint32_t word = byte(sums.a);
    // One step of 128 for b = 0, so that an open cell is exactly open.
    for (int i = 0; i < 3; ++i) {
        word |= static_cast<std::uint32_t>(std::clamp(sums.b[i] * 127.0 + 128.5, 0.0, 255.0)) << (8 * i + 8);
    }
    return static_cast<std::int32_t>(word);
}

}  // namespace

SkyVisibility::SkyVisibility(const Geometry &geometry, double cell_m, double reach_m, int threads, Isa isa) {
    double lo[3] = {kWidest_m, kWidest_m, kWidest_m}, hi[3] = {-kWidest_m, -kWidest_m, -kWidest_m};
    for (std::size_t g = 0; g < geometry.geoms().size(); ++g) {
        const Geom &geom = geometry.geoms()[g];
        if (geom.moving || !geometry.shown(static_cast<int>(g)) || std::isinf(geom.half[0]) || std::isinf(geom.half[1])) continue;
        const Aabb &box = geometry.world_box(static_cast<int>(g));
        for (int i = 0; i < 3; ++i) {
            lo[i] = std::min(lo[i], std::max<double>(box.lo[i], -kWidest_m));
            hi[i] = std::max(hi[i], std::min<double>(box.hi[i], kWidest_m));
        }
    }
    for (int i = 0; i < 3; ++i) {
        if (!(lo[i] <= hi[i])) lo[i] = hi[i] = 0.0;
        if (i < 2) lo[i] -= cell_m;
        hi[i] += i < 2 ? cell_m : kAbove_m;
    }
    const double volume = (hi[0] - lo[0]) * (hi[1] - lo[1]) * (hi[2] - lo[2]);
    const double edge = std::max(cell_m, std::cbrt(volume / kMostCells));
    per_m = static_cast<float>(1.0 / edge);
    for (int i = 0; i < 3; ++i) {
        size[i] = std::max(2, static_cast<std::int32_t>(std::ceil((hi[i] - lo[i]) / edge)));
        // The lowest cells lie just above the lowest ground.
        corner_W[i] = static_cast<float>(lo[i] + (i < 2 ? 0.5 : 0.25) * edge);
    }
    const auto layer = static_cast<std::size_t>(size[0]) * static_cast<std::size_t>(size[1]);
    std::vector<double> origin(3 * layer), ray(3 * layer), range(layer), normal(3 * layer);
    std::vector<std::int32_t> geom(layer), order(layer);
    for (std::size_t i = 0; i < layer; ++i) order[i] = static_cast<std::int32_t>(i);
    RayCaster caster(geometry);
    const std::vector<Direction> all = directions();
    std::vector<Sums> sums(layer * static_cast<std::size_t>(size[2]));
    for (std::int32_t k = 0; k < size[2]; ++k) {
        Sums *const here = sums.data() + layer * static_cast<std::size_t>(k);
        for (std::size_t i = 0; i < layer; ++i) {
            origin[3 * i] = corner_W[0] + edge * static_cast<double>(i % static_cast<std::size_t>(size[0]));
            origin[3 * i + 1] = corner_W[1] + edge * static_cast<double>(i / static_cast<std::size_t>(size[0]));
            origin[3 * i + 2] = corner_W[2] + edge * k;
        }
        for (const Direction &d : all) {
            for (std::size_t i = 0; i < layer; ++i) std::copy_n(d.w, 3, &ray[3 * i]);
            const bool down = d.w[2] < 0.0;
            caster.cast(origin.data(), false, ray.data(), layer, 0.0, reach_m, CastSkips{}, order.data(), threads, isa,
                        {range.data(), geom.data(), down ? normal.data() : nullptr, nullptr});
            for (std::size_t i = 0; i < layer; ++i) {
                if (geom[i] >= 0 && !(down && normal[3 * i + 2] > kLevel)) continue;
                here[i].a += 1.0 / kDirections;
                for (int c = 0; c < 3; ++c) here[i].b[c] += 3.0 / kDirections * d.w[c];
            }
        }
    }
    cell.assign(sums.size(), kOpen);
    for (std::int32_t z = 0; z < size[2]; ++z) {
        for (std::int32_t y = 0; y < size[1]; ++y) {
            for (std::int32_t x = 0; x < size[0]; ++x) {
                const auto at = [&](std::int32_t i, std::int32_t j, std::int32_t k) {
                    return static_cast<std::size_t>((k * size[1] + j) * size[0] + i);
                };
                Sums found = sums[at(x, y, z)];
                if (found.blocked()) {
                    found = {};
                    double count = 0.0;
                    for (std::int32_t k = std::max(0, z - 1); k <= std::min(size[2] - 1, z + 1); ++k) {
                        for (std::int32_t j = std::max(0, y - 1); j <= std::min(size[1] - 1, y + 1); ++j) {
                            for (std::int32_t i = std::max(0, x - 1); i <= std::min(size[0] - 1, x + 1); ++i) {
                                const Sums &near = sums[at(i, j, k)];
                                if (near.blocked()) continue;
                                count += 1.0;
                                found.a += near.a;
                                for (int c = 0; c < 3; ++c) found.b[c] += near.b[c];
                            }
                        }
                    }
                    if (count > 0.0) {
                        found.a /= count;
                        for (double &b : found.b) b /= count;
                    }
                }
                cell[at(x, y, z)] = packed(found);
            }
        }
    }
}

}  // namespace hil::sim::frame
