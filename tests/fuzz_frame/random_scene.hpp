// Random scenes that no sane map would hold, by seed: shapes without size, meshes without area or with vertices that are
// no numbers, poses that are none, cameras inside geometry, pictures of one pixel and of millions.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <vector>

#include "geometry.hpp"
#include "raster.hpp"
#include "scenery.hpp"

namespace fuzz {

using namespace hil::sim::frame;

// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
class RandomGenerator {
public:
    bool bent = false;  // it has made a rotation that is none: bounds, and so what is culled, promise nothing
    explicit RandomGenerator(std::uint64_t seed) : state_(seed) {}
    std::uint64_t bits() {
        std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return z ^ (z >> 31);
    }
    int below(int n) { return static_cast<int>(bits() % static_cast<std::uint64_t>(n)); }
    bool one_in(int n) { return below(n) == 0; }
    double uniform(double low, double high) {
        return low + (high - low) * (static_cast<double>(bits() >> 11) * 0x1p-53);
    }
    // Mostly an ordinary number; now and then one that breaks what was not made for it.
    double number(double low, double high) {
        if (!one_in(24)) return uniform(low, high);
        constexpr double inf = std::numeric_limits<double>::infinity();
        const double odd[] = {0.0, -0.0, 1e-310, 1e-38, -1e-20, 1e-9, 1e5, -1e6, 9.9e6, 1e8, 1e19, -1e30, 3.5e38, 1e300,
                              inf, -inf, std::numeric_limits<double>::quiet_NaN()};
        return odd[below(static_cast<int>(std::size(odd)))];
    }

private:
    std::uint64_t state_;
};

inline void rotation(RandomGenerator &rng, double *R) {
    double q[4], length = 0.0;
    for (double &x : q) x = rng.uniform(-1.0, 1.0), length += x * x;
    length = std::sqrt(length) + 1e-12;
    for (double &x : q) x /= length;
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double made[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                            2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                            2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (int i = 0; i < 9; ++i) R[i] = made[i];
    if (rng.one_in(60)) {
        rng.bent = true;
        if (rng.one_in(2)) R[rng.below(9)] = rng.number(-1.0, 1.0);
        else std::fill(R, R + 9, 0.0);
    }
}

// One or two closed boxes apart from each other, each wound outwards or inwards, now and then with a face missing.
inline int add_boxes(RandomGenerator &rng, Geometry &geometry) {
    constexpr std::int32_t faces[36] = {0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1,
                                        2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3};
    std::vector<float> vertex;
    std::vector<std::int32_t> triangle;
    for (int box = 0; box < 1 + rng.below(2); ++box) {
        double half[3];
        for (double &h : half) h = rng.uniform(0.05, 2.0);
        const bool inwards = rng.one_in(4);
        const int missing = rng.one_in(4) ? 3 * rng.below(12) : -1;
        for (int i = 0; i < 8; ++i) {
            for (int k = 0; k < 3; ++k) {
                const double side = i >> (2 - k) & 1 ? half[k] : -half[k];
                vertex.push_back(static_cast<float>(side + (k == 2 ? 5.0 * box : 0.0)));
            }
        }
        for (int i = 0; i < 36; i += 3) {
            if (i == missing) continue;
            for (int k = 0; k < 3; ++k) triangle.push_back(8 * box + faces[i + (inwards ? 2 - k : k)]);
        }
    }
    return geometry.add_mesh(vertex.data(), vertex.size() / 3, triangle.data(), triangle.size() / 3, nullptr, nullptr);
}

inline int add_mesh(RandomGenerator &rng, Geometry &geometry) {
    if (rng.one_in(3)) return add_boxes(rng, geometry);
    const int vertices = rng.one_in(10) ? 0 : 1 + rng.below(40);
    const int triangles = vertices == 0 || rng.one_in(10) ? 0 : rng.below(80);
    const double reach = rng.uniform(0.01, 5.0);
    std::vector<float> vertex, uv, normal;
    for (int i = 0; i < 3 * vertices; ++i) vertex.push_back(static_cast<float>(rng.number(-reach, reach)));
    std::vector<std::int32_t> triangle;
    for (int i = 0; i < triangles; ++i) {
        const int a = rng.below(vertices), b = rng.below(vertices), c = rng.below(vertices);
        // No area, by one corner twice or by all three on a line.
        triangle.insert(triangle.end(), {a, rng.one_in(8) ? a : b, rng.one_in(8) ? b : c});
        for (int k = 0; k < 6; ++k) uv.push_back(static_cast<float>(rng.number(-2.0, 2.0)));
        for (int k = 0; k < 9; ++k) normal.push_back(static_cast<float>(rng.number(-1.0, 1.0)));
    }
    if (triangles > 0 && rng.one_in(60)) triangle[static_cast<std::size_t>(rng.below(3 * triangles))] = vertices + rng.below(9) - 9;
    const bool with_uv = rng.one_in(2), with_normal = rng.one_in(2);
    return geometry.add_mesh(vertex.data(), static_cast<std::size_t>(vertices), triangle.data(),
                             static_cast<std::size_t>(triangles), with_uv ? uv.data() : nullptr,
                             with_normal ? normal.data() : nullptr);
}

inline Geom random_geom(RandomGenerator &rng, int meshes) {
    constexpr Shape shapes[] = {Shape::kPlane, Shape::kSphere, Shape::kCapsule, Shape::kEllipsoid,
                                Shape::kCylinder, Shape::kBox, Shape::kMesh};
    Geom g{};
    g.shape = shapes[rng.below(meshes > 0 ? 7 : 6)];
    g.moving = rng.one_in(3);
    g.visible = !rng.one_in(10);
    g.class_id = static_cast<std::uint8_t>(rng.below(256));
    g.surface = static_cast<std::uint8_t>(rng.below(256));
    g.instance = static_cast<std::uint16_t>(rng.below(65536));
    g.mesh = g.shape == Shape::kMesh ? rng.below(meshes) : -1;
    if (rng.one_in(200)) g.mesh = meshes + 3;
    for (double &size : g.size) size = rng.number(0.0, rng.one_in(6) ? 60.0 : 3.0);
    if (g.shape == Shape::kPlane && rng.one_in(2)) g.size[0] = g.size[1] = 0.0;
    for (double &p : g.p_WG) p = rng.number(-12.0, 12.0);
    rotation(rng, g.R_WG);
    return g;
}

// Bad meshes and geoms are refused with invalid_argument; what was added before stays.
inline void fill(RandomGenerator &rng, Geometry &geometry) {
    const int meshes = rng.below(4), geoms = rng.one_in(12) ? 0 : rng.one_in(10) ? 400 : rng.below(40);
    for (int i = 0; i < meshes; ++i) {
        try {
            add_mesh(rng, geometry);
        } catch (const std::invalid_argument &) {
        }
    }
    for (int i = 0; i < geoms; ++i) {
        try {
            geometry.add_geom(random_geom(rng, static_cast<int>(geometry.meshes().size())));
        } catch (const std::invalid_argument &) {
        }
    }
    geometry.finish();
}

inline void stir(RandomGenerator &rng, Geometry &geometry) {
    for (std::size_t i = 0; i < geometry.geoms().size(); ++i) {
        if (!geometry.geoms()[i].moving) continue;
        double p[3], R[9], v[3], w[3];
        for (double &x : p) x = rng.number(-12.0, 12.0);
        for (double &x : v) x = rng.number(-9.0, 9.0);
        for (double &x : w) x = rng.number(-9.0, 9.0);
        rotation(rng, R);
        geometry.move(static_cast<int>(i), p, R, v, w);
    }
}

inline RasterCamera random_camera(RandomGenerator &rng, const Geometry &geometry) {
    RasterCamera camera{};
    for (double &x : camera.p_WC) x = rng.number(-15.0, 15.0);
    if (!geometry.geoms().empty() && rng.one_in(3)) {  // inside something
        const Geom &g = geometry.geoms()[static_cast<std::size_t>(rng.below(static_cast<int>(geometry.geoms().size())))];
        for (int i = 0; i < 3; ++i) camera.p_WC[i] = g.p_WG[i];
    }
    rotation(rng, camera.R_WC);
    for (double &x : camera.v_W) x = rng.number(-9.0, 9.0);
    return camera;
}

// Levels of a texture: an array, or a vector that has to grow first.
template <class Offsets>
void make_room(Offsets &offsets) {
    if constexpr (requires { offsets.resize(16); }) offsets.resize(16);
}

// Well-formed, as the bindings see to: powers of two from 4, each level half the one before; the rest is anything.
inline Texture random_texture(RandomGenerator &rng) {
    Texture t;
    t.cube = rng.one_in(3);
    t.width = 4 << rng.below(5);
    const int face = t.cube ? t.width : 4 << rng.below(5);
    t.height = t.cube ? 6 * face : face;
    make_room(t.offset);
    for (int w = t.width, h = face; w >= 4 && h >= 4; w /= 2, h /= 2) {
        t.offset[t.levels++] = static_cast<std::int32_t>(t.texel.size());
        for (int i = 0; i < w * h * (t.cube ? 6 : 1); ++i) t.texel.push_back(static_cast<std::int32_t>(rng.bits()));
        if (rng.one_in(6)) break;
    }
    return t;
}

inline Scenery random_scenery(RandomGenerator &rng, std::size_t geoms) {
    Scenery scenery;
    const int textures = rng.below(4);
    for (int i = 0; i < textures; ++i) scenery.textures.push_back(random_texture(rng));
    for (std::size_t i = 0; i < geoms; ++i) {
        Appearance a;
        for (float &c : a.rgb) c = static_cast<float>(rng.number(0.0, 1.0));
        a.emission = static_cast<float>(rng.number(0.0, 1.0));
        a.texture = textures > 0 && rng.one_in(2) ? rng.below(textures) : -1;
        for (float &r : a.repeat) r = static_cast<float>(rng.number(0.01, 20.0));
        a.per_metre = rng.one_in(2);
        scenery.geoms.push_back(a);
    }
    if (rng.one_in(4)) return without_textures(scenery);
    return scenery;
}

inline Daylight random_light(RandomGenerator &rng) {
    Daylight light;
    double sun[3];
    for (double &s : sun) s = rng.uniform(-1.0, 1.0);
    const double length = std::sqrt(sun[0] * sun[0] + sun[1] * sun[1] + sun[2] * sun[2]) + 1e-9;
    for (int i = 0; i < 3; ++i) light.sun_W[i] = static_cast<float>(sun[i] / length);
    for (float *rgb : {light.sun_rgb, light.sky_rgb, light.ground_rgb, light.zenith_rgb, light.horizon_rgb, light.air_rgb}) {
        for (int i = 0; i < 3; ++i) rgb[i] = static_cast<float>(rng.number(0.0, 1.5));
    }
    light.extinction_per_m = rng.one_in(2) ? 0.0f : static_cast<float>(rng.number(0.0, 0.2));
    light.haze_m = static_cast<float>(rng.number(0.0, 1000.0));
    return light;
}

}  // namespace fuzz
