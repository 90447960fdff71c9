// Takes pictures of random scenes (random_scene.hpp) until its time is over; built with AddressSanitizer and
// UndefinedBehaviorSanitizer.
//
// Beyond not crashing and not writing beside its outputs: a picture is the same whatever was culled, for any number of
// threads and every instruction set; a channel is the same whatever others are asked for; rows taken alone are those of
// the whole picture, and nothing but them is written.
//
//     fuzz_frame SECONDS FIRST_SEED      seeds from FIRST_SEED on; says how many
//     fuzz_frame seed SEED               that one alone
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>

#include "guarded.hpp"
#include "picture.hpp"
#include "random_scene.hpp"
#include "ray_cast.hpp"

namespace fuzz {

constexpr unsigned kAll = 0x1ff;

struct Failure : std::runtime_error {
    using std::runtime_error::runtime_error;
};

void same(const Channels &a, const Channels &b, int row0, int row1, const char *what) {
    const std::string where = a.first_difference(b, row0, row1);
    if (!where.empty()) throw Failure(std::string(what) + ": " + where);
}

// Everything about a camera but its pose, from a seed of its own: made again for another instruction set, and `scale` times
// as fine.
std::unique_ptr<Raster> random_raster(const Geometry &geometry, bool huge, Isa isa, std::uint64_t seed, int scale = 1) {
    RandomGenerator rng(seed);
    int width = 1 + rng.below(rng.one_in(3) ? 9 : 100), height = 1 + rng.below(rng.one_in(3) ? 9 : 80);
    if (rng.one_in(12)) width = height = 1;
    if (huge) width = height = 4096;
    if (rng.one_in(60)) width = rng.one_in(2) ? 0 : -3;
    if (rng.one_in(60)) height = rng.one_in(2) ? 1 << 20 : std::numeric_limits<int>::max();
    if (!huge && rng.one_in(3)) {
        width = scale * std::clamp(width, 1, 200), height = scale * std::clamp(height, 1, 200);
        std::vector<double> directions;
        const double wide = rng.uniform(0.1, 3.2);  // half of the field of view: up to all around
        for (int y = 0; y < height; ++y) {
            for (int x = 0; x < width; ++x) {
                const double u = (x + 0.5) / width * 2.0 - 1.0, v = (y + 0.5) / height * 2.0 - 1.0;
                const double angle = wide * std::min(1.0, std::hypot(u, v)), turn = std::atan2(v, u);
                double d[3] = {std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn), std::cos(angle)};
                if (rng.one_in(50000)) d[rng.below(3)] = rng.number(-1.0, 1.0);
                directions.insert(directions.end(), d, d + 3);
            }
        }
        return std::make_unique<Raster>(geometry, width, height, directions.data(), isa);
    }
    const double f = rng.number(0.2, 2.0) * width, fy = rng.one_in(5) ? rng.number(0.1, 300.0) : f;
    const double cx = rng.one_in(4) ? rng.number(-50.0, 200.0) : 0.5 * width, cy = rng.one_in(4) ? rng.number(-50.0, 200.0) : 0.5 * height;
    return std::make_unique<Raster>(geometry, scale * width, scale * height, Projection::kPinhole, scale * f, scale * fy, scale * cx,
                                    scale * cy, isa);
}

struct Shot {
    RasterCamera camera;
    RasterOptions options;
    Daylight light;
    const SunShadows *shadows;
    const SkyVisibility *sky;
};

Channels take(Picture &picture, const Shot &shot, unsigned wanted, int row0, int row1, int threads) {
    const VisibilityBuffer &b = picture.raster().buffer();
    Channels channels(b.width, b.height, wanted);
    picture.take(shot.camera, shot.options, shot.light, shot.shadows, shot.sky, channels.outputs(), row0, row1, threads);
    if (!channels.intact()) throw Failure("written beside the outputs");
    return channels;
}

Channels take_smooth(Picture &picture, Picture &finer, const Shot &shot, int row0, int row1, int threads) {
    const VisibilityBuffer &b = picture.raster().buffer();
    Channels channels(b.width, b.height, kAll);
    picture.take_smooth(finer, shot.camera, shot.options, shot.light, shot.shadows, shot.sky, channels.outputs(), row0, row1, threads);
    if (!channels.intact()) throw Failure("smooth outlines: written beside the outputs");
    return channels;
}

// Random rays, some odd: the same answer with and without the tree, by any instruction set and number of threads.
void rays(RandomGenerator &rng, const Geometry &geometry) {
    constexpr std::size_t kRays = 64;
    std::vector<double> origin(3 * kRays), direction(3 * kRays);
    for (double &x : origin) x = rng.number(-15.0, 15.0);
    for (double &x : direction) x = rng.number(-1.0, 1.0);
    RayCaster caster(geometry);
    caster.refresh();
    const double t_max = rng.one_in(3) ? rng.number(0.0, 30.0) : 1e6;
    std::vector<double> first_range;
    std::vector<std::int32_t> first_geom;
    const auto cast = [&](bool tree, bool max_range, int threads, Isa isa, const char *what) {
        std::vector<double> range(kRays), normal(3 * kRays), velocity(kRays);
        std::vector<std::int32_t> geom(kRays);
        const CastOutput out{range.data(), geom.data(), normal.data(), velocity.data()};
        caster.cast(origin.data(), false, direction.data(), kRays, 0.0, t_max, {tree, max_range}, nullptr, threads, isa, out);
        if (first_geom.empty()) {
            first_range = range, first_geom = geom;
            return;
        }
        for (std::size_t i = 0; i < kRays; ++i) {
            const bool same_range = std::memcmp(&range[i], &first_range[i], sizeof(double)) == 0;
            if (geom[i] != first_geom[i] || !same_range) {
                throw Failure(std::string("rays, ") + what + ": ray " + std::to_string(i));
            }
        }
    };
    cast(true, true, 1, best_isa(), "");
    cast(true, true, 3, best_isa(), "number of threads");
    for (const Isa isa : {Isa::kBase, Isa::kAvx2}) {
        if (has_isa(isa)) cast(true, true, 1, isa, isa_name(isa));
    }
    if (rng.bent) return;  // boxes hold what rotations that are none do to a shape only roughly
    cast(false, true, 1, best_isa(), "tree");
    cast(true, false, 1, best_isa(), "greatest range");
}

void one(std::uint64_t seed) {
    RandomGenerator rng(seed);
    const bool huge = seed % 500 == 7;
    Geometry geometry;
    fill(rng, geometry);
    const Scenery scenery = random_scenery(rng, geometry.geoms().size());
    Shot shot{};
    shot.light = random_light(rng);
    const std::uint64_t raster_seed = rng.bits();
    const Shading shading{rng.one_in(2), rng.one_in(2), rng.one_in(2), rng.one_in(2), {1.0f, 0.5f, 2.0f}};
    std::unique_ptr<Picture> picture;
    std::unique_ptr<SkyVisibility> sky;
    std::unique_ptr<SunShadows> shadows;
    int resolution = 0;
    try {
        picture = std::make_unique<Picture>(random_raster(geometry, huge, best_isa(), raster_seed), scenery, shading);
        if (rng.one_in(3)) {
            resolution = 1 + rng.below(300);
            shadows = std::make_unique<SunShadows>(geometry, shot.light.sun_W, resolution, best_isa());
        }
    } catch (const std::invalid_argument &) {
        if (picture == nullptr) return;  // refused in words; without the sun there is a picture all the same
    }
    if (rng.one_in(30)) sky = std::make_unique<SkyVisibility>(geometry, rng.uniform(0.5, 3.0), 10.0, 1, best_isa());
    shot.sky = sky.get();
    if (rng.one_in(8)) shot.options.near_t = static_cast<float>(rng.uniform(1e-3, 3.0));
    if (rng.one_in(8)) shot.options.far_t = static_cast<float>(rng.uniform(3.0, 1e5));
    const int height = picture->raster().buffer().height;
    std::unique_ptr<Picture> finer;
    try {
        if (!huge && rng.one_in(2)) finer = std::make_unique<Picture>(random_raster(geometry, huge, best_isa(), raster_seed, 2), scenery, shading);
    } catch (const std::invalid_argument &) {  // twice the focal length is beyond the bound, refused in words
    }
    for (int number = 0; number < (huge ? 1 : 3); ++number) {
        stir(rng, geometry);
        if (shadows != nullptr) shadows->update(true, nullptr, nullptr);
        shot.shadows = shadows.get();
        shot.camera = random_camera(rng, geometry);
        const Channels whole = take(*picture, shot, kAll, 0, height, 1);
        if (huge) continue;
        const auto wanted = static_cast<unsigned>(rng.below(kAll + 1));
        same(whole, take(*picture, shot, wanted, 0, height, 1), 0, height, "other channels asked for");
        std::unique_ptr<Channels> smooth;
        if (finer != nullptr) smooth = std::make_unique<Channels>(take_smooth(*picture, *finer, shot, 0, height, 1));
        for (const Isa isa : {Isa::kBase, Isa::kAvx2}) {
            if (!has_isa(isa) || isa == best_isa()) continue;
            Picture other(random_raster(geometry, huge, isa, raster_seed), scenery, shading);
            Shot again = shot;
            std::unique_ptr<SunShadows> sun;
            if (shadows != nullptr) {
                sun = std::make_unique<SunShadows>(geometry, shot.light.sun_W, resolution, isa);
                sun->update(true, nullptr, nullptr);
                again.shadows = sun.get();
            }
            same(whole, take(other, again, kAll, 0, height, 1), 0, height, isa_name(isa));
            if (smooth == nullptr) continue;
            Picture other_finer(random_raster(geometry, huge, isa, raster_seed, 2), scenery, shading);
            same(*smooth, take_smooth(other, other_finer, again, 0, height, 1), 0, height, "smooth outlines, instruction set");
        }
        if (rng.bent) continue;  // threads and rows have bounds of their own
        same(whole, take(*picture, shot, kAll, 0, height, 2 + rng.below(6)), 0, height, "number of threads");
        if (height > 4) {
            const int row0 = 4 * rng.below(height / 4);
            const int row1 = std::min(height, row0 + 4 * (1 + rng.below((height - row0) / 4 + 1)));
            const Channels rows = take(*picture, shot, kAll, row0, row1, 1 + rng.below(3));
            same(whole, rows, row0, row1, "rows alone");
            if (!rows.only_rows(row0, row1)) throw Failure("other rows than those asked for are written");
            if (smooth != nullptr) {
                const Channels smooth_rows = take_smooth(*picture, *finer, shot, row0, row1, 1 + rng.below(3));
                same(*smooth, smooth_rows, row0, row1, "smooth outlines, rows alone");
                if (!smooth_rows.only_rows(row0, row1)) throw Failure("smooth outlines: other rows than those asked for are written");
            }
        }
        Shot slow = shot;
        if (shadows != nullptr) {
            SunShadows some(geometry, shot.light.sun_W, resolution, best_isa());
            some.update(true, &picture->raster(), &shot.camera);
            slow.shadows = &some;
            same(whole, take(*picture, slow, kAll, 0, height, 1), 0, height, "shadows that the picture can show");
            slow.shadows = shot.shadows;
        }
        slow.options.frustum_culling = false;
        same(whole, take(*picture, slow, kAll, 0, height, 1), 0, height, "frustum culling");
        slow.options = shot.options;
        slow.options.occlusion_culling = false;
        same(whole, take(*picture, slow, kAll, 0, height, 1), 0, height, "occlusion culling");
        if (smooth != nullptr) same(*smooth, take_smooth(*picture, *finer, slow, 0, height, 1), 0, height, "smooth outlines, occlusion culling");
        slow.options = shot.options;
        slow.options.hide_backs = false;
        same(whole, take(*picture, slow, kAll, 0, height, 1), 0, height, "backs of meshes");
    }
    if (!huge) rays(rng, geometry);
}

}  // namespace fuzz

int main(int argc, char **argv) {
    if (argc != 3) {
        std::fprintf(stderr, "usage: fuzz_frame SECONDS FIRST_SEED | fuzz_frame seed SEED\n");
        return 2;
    }
    const bool single = std::strcmp(argv[1], "seed") == 0;
    const double seconds = single ? 0.0 : std::atof(argv[1]);
    const std::uint64_t first = std::strtoull(argv[2], nullptr, 10);
    const auto began = std::chrono::steady_clock::now();
    std::uint64_t seed = first;
    do {
        try {
            fuzz::one(seed);
        } catch (const std::exception &failure) {
            std::fprintf(stderr, "seed %llu: %s\n", static_cast<unsigned long long>(seed), failure.what());
            return 1;
        }
        ++seed;
    } while (std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count() < seconds);
    std::printf("%llu scenes\n", static_cast<unsigned long long>(seed - first));
    return 0;
}
