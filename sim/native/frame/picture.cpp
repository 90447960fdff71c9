#include "picture.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "sky_pattern.hpp"
#include "view.hpp"

namespace hil::sim::frame {

HIL_BY_ISA(ResolveKernels, resolve_kernels, resolve_kernels_of_isa)

namespace {

constexpr double kMargin = 2.0;          // [m] around the geoms that cast shadows
constexpr double kWidest = 2000.0;       // [m] greatest extent of a scene with shadows
constexpr double kDepths = 1e7;          // [m] below everything

}  // namespace

SunShadows::SunShadows(const Geometry &geometry, const float *sun_W, int resolution, Isa isa) : geometry_(geometry) {
    const double length = std::sqrt(static_cast<double>(sun_W[0]) * sun_W[0] + static_cast<double>(sun_W[1]) * sun_W[1] +
                                    static_cast<double>(sun_W[2]) * sun_W[2]);
    if (!(length > 1e-6) || !(sun_W[2] > 0.0f))
        throw std::invalid_argument("the sun must be above the horizon: sun_W needs a positive z");
    double z[3], x[3], y[3];
    for (int i = 0; i < 3; ++i) z[i] = -sun_W[i] / length;
    // x level, y completes a right-handed frame.
    const double level = std::sqrt(z[0] * z[0] + z[1] * z[1]);
    x[0] = level > 1e-9 ? -z[1] / level : 1.0, x[1] = level > 1e-9 ? z[0] / level : 0.0, x[2] = 0.0;
    for (int i = 0; i < 3; ++i) y[i] = z[(i + 1) % 3] * x[(i + 2) % 3] - z[(i + 2) % 3] * x[(i + 1) % 3];
    for (int i = 0; i < 3; ++i) {
        camera_.R_WC[3 * i] = x[i];
        camera_.R_WC[3 * i + 1] = y[i];
        camera_.R_WC[3 * i + 2] = z[i];
    }
    lowest_m_ = std::numeric_limits<double>::infinity();
    for (const std::int32_t plane : geometry.unbounded()) {
        const Geom &g = geometry.geoms()[static_cast<std::size_t>(plane)];
        lowest_m_ = std::min(lowest_m_, g.R_WG[2] == 0.0 && g.R_WG[5] == 0.0 ? g.p_WG[2] : -kDepths);
    }
    double lo[3], hi[3];
    std::fill(lo, lo + 3, std::numeric_limits<double>::infinity());
    std::fill(hi, hi + 3, -std::numeric_limits<double>::infinity());
    for (std::size_t g = 0; g < geometry.geoms().size(); ++g) {
        const Geom &geom = geometry.geoms()[g];
        // Moving geoms are left out: the extent of the map must not depend on their current poses.
        if (geom.moving || !geometry.shown(static_cast<int>(g)) || std::isinf(geom.half[0]) || std::isinf(geom.half[1])) continue;
        const Aabb &box = geometry.world_box(static_cast<int>(g));
        lowest_m_ = std::min(lowest_m_, static_cast<double>(box.lo[2]));
        for (int corner = 0; corner < 8; ++corner) {
            double p[3];
            for (int i = 0; i < 3; ++i) p[i] = std::clamp<double>(corner >> i & 1 ? box.hi[i] : box.lo[i], -kWidest, kWidest);
            const double *axes[3] = {x, y, z};
            for (int k = 0; k < 3; ++k) {
                const double at = axes[k][0] * p[0] + axes[k][1] * p[1] + axes[k][2] * p[2];
                lo[k] = std::min(lo[k], at);
                hi[k] = std::max(hi[k], at);
            }
        }
    }
    for (int k = 0; k < 3; ++k) {
        if (!(lo[k] <= hi[k])) lo[k] = hi[k] = 0.0;
        lo[k] -= kMargin * (k == 2 ? 50.0 : 1.0), hi[k] += kMargin;  // moving geoms may be higher than static ones
    }
    const double extent = std::max(hi[0] - lo[0], hi[1] - lo[1]);
    pixels_per_m_ = resolution / extent;
    for (int i = 0; i < 3; ++i) camera_.p_WC[i] = x[i] * lo[0] + y[i] * lo[1] + z[i] * lo[2];
    const int width = std::max(8, static_cast<int>(std::ceil((hi[0] - lo[0]) * pixels_per_m_)));
    const int height = std::max(8, static_cast<int>(std::ceil((hi[1] - lo[1]) * pixels_per_m_)));
    for (Map *map : {&static_, &moving_}) {
        map->raster = std::make_unique<Raster>(geometry, width, height, Projection::kParallel, pixels_per_m_,
                                               pixels_per_m_, 0.0, 0.0, isa);
    }
}

void SunShadows::draw(Map &map, const RasterOptions &options) {
    map.raster->draw(camera_, options, 0, map.raster->buffer().height, 1,
                     [&map](const Raster::Band &band) { map.band = &band; });
    map.version = geometry_.version();
    note_sole(map, options.sparse);
}

// The areas are blocks; with `sparse` those of 4 x 4 blocks, and one that any geom may touch counts as one of several, so
// that no pixel is read.
void SunShadows::note_sole(Map &map, bool sparse) {
    const VisibilityBuffer &b = map.raster->buffer();
    map.area_power = sparse ? 4 : 2;
    const int blocks = (1 << map.area_power) / kBlock;
    const int areas_x = ceil_div(b.blocks_x, blocks), areas_y = ceil_div(b.blocks_y, blocks);
    map.sole.assign(static_cast<std::size_t>(areas_x) * static_cast<std::size_t>(areas_y), -1);
    if (sparse) {
        for (const DrawnGeom &g : map.band->drawn) {
            for (int y = std::max(g.y0 - 1, 0) / blocks; y <= (g.y1 - 1) / blocks; ++y) {
                for (int x = std::max(g.x0 - 1, 0) / blocks; x <= (g.x1 - 1) / blocks; ++x) {
                    map.sole[static_cast<std::size_t>(y * areas_x + x)] = kSeveral;
                }
            }
        }
        return;
    }
    for (int y = 0; y < areas_y; ++y) {
        for (int x = 0; x < areas_x; ++x) {
            const auto at = static_cast<std::size_t>(y * areas_x + x);
            const std::size_t right = at + (x + 1 < areas_x ? 1 : 0), down = y + 1 < areas_y ? static_cast<std::size_t>(areas_x) : 0;
            const std::int32_t *const ids = &b.geom[16 * at], one = ids[0];
            bool alone = std::all_of(ids, ids + 16, [one](std::int32_t id) { return id == one; }) && b.geom[16 * (right + down)] == one;
            for (std::size_t i = 0; i < 4; ++i) alone = alone && b.geom[16 * right + 4 * i] == one && b.geom[16 * (at + down) + i] == one;
            map.sole[at] = alone ? one : kSeveral;
        }
    }
}

// Adds the moving geoms whose shadows a picture can show to those in the map; returns true if there was any. A point reads
// the pixels around it, so a geom that none of a picture's points comes near does not matter to it.
bool SunShadows::add_casters(const Raster *picture, const RasterCamera *camera) {
    const auto &moving = geometry_.moving();
    double lowest_m = lowest_m_;
    for (const std::int32_t geom : moving) {
        if (geometry_.shown(geom)) lowest_m = std::min(lowest_m, static_cast<double>(geometry_.world_box(geom).lo[2]));
    }
    const double pad = 2.0 / pixels_per_m_ + 1e-3, down = camera_.R_WC[8];
    View view{};
    const bool bounded = picture != nullptr && picture->rays().projection == Projection::kPinhole;
    if (bounded) view = picture->view(*camera, {}, 0, ceil_div(picture->buffer().height, kBlock));
    bool any = false;
    for (std::size_t i = 0; i < moving.size(); ++i) {
        if (casters_[i] != 0 || !geometry_.shown(moving[i])) continue;
        if (bounded) {
            const Aabb &box = geometry_.world_box(moving[i]);
            const double length = (box.hi[2] - lowest_m + 1.0) / -down;  // of the shadow, and a metre for rounding
            double centre[3], half[3], way[3];
            for (int k = 0; k < 3; ++k) {
                centre[k] = 0.5 * (static_cast<double>(box.lo[k]) + box.hi[k]);
                half[k] = 0.5 * (static_cast<double>(box.hi[k]) - box.lo[k]);
                way[k] = camera_.R_WC[3 * k + 2] * length;
            }
            if (view.outside_on_its_way(centre, half, way, pad)) continue;
        }
        casters_[i] = 1;
        any = true;
    }
    return any;
}

void SunShadows::update(bool reuse_static, const Raster *picture, const RasterCamera *camera) {
    RasterOptions options;
    options.near_t = 0.0f;
    options.far_t = 1e6f;
    if (static_.band == nullptr || !reuse_static) {
        options.draw_moving = false;
        draw(static_, options);
    }
    if (geometry_.moving().empty()) return;
    const bool moved = moving_.version != geometry_.version();
    if (moved) casters_.assign(geometry_.moving().size(), 0);
    if (add_casters(picture, camera) || moved) {
        options.moving = casters_.data();
        options.draw_static = false;
        options.draw_moving = true;
        options.occlusion_culling = false;
        options.sparse = true;
        draw(moving_, options);
    }
}

void SunShadows::fill(ResolveJob &job, const RasterCamera &camera) const {
    for (int r = 0; r < 3; ++r) {
        double at = 0.0;
        for (int k = 0; k < 3; ++k) at += camera_.R_WC[3 * k + r] * (camera.p_WC[k] - camera_.p_WC[k]);
        job.camera_in_sun[r] = static_cast<float>(at);
        for (int c = 0; c < 3; ++c) {
            double m = 0.0;
            for (int k = 0; k < 3; ++k) m += camera_.R_WC[3 * k + r] * camera.R_WC[3 * k + c];
            job.camera_to_sun[3 * r + c] = static_cast<float>(m);
        }
    }
    job.shadows = 0;
    for (const Map *map : {&static_, &moving_}) {
        if (map->band == nullptr || map->band->drawn.empty()) continue;
        ShadowMap &shadow = job.shadow[job.shadows++];
        shadow.buffer = &map->raster->buffer();
        shadow.rays = &map->raster->rays();
        shadow.drawn = map->band->drawn.data();
        shadow.drawn_of_geom = map->band->drawn_of_geom.data();
        shadow.sole = map->sole.data();
        shadow.area_power = map->area_power;
        shadow.areas_x = ceil_div(shadow.buffer->blocks_x, (1 << map->area_power) / kBlock);
        shadow.x0 = shadow.buffer->blocks_x, shadow.y0 = shadow.buffer->blocks_y;
        shadow.x1 = shadow.y1 = 0;
        for (const DrawnGeom &g : map->band->drawn) {
            shadow.x0 = std::min(shadow.x0, g.x0), shadow.x1 = std::max(shadow.x1, g.x1);
            shadow.y0 = std::min(shadow.y0, g.y0), shadow.y1 = std::max(shadow.y1, g.y1);
        }
        // In pixels; a point also reads the next pixel to the right and below.
        shadow.x0 *= 4, shadow.y0 *= 4;
        shadow.x1 = std::min(4 * shadow.x1, shadow.buffer->width) - 1;
        shadow.y1 = std::min(4 * shadow.y1, shadow.buffer->height) - 1;
    }
}

void Picture::take(const RasterCamera &camera, const RasterOptions &options, const Daylight &light,
                   const SunShadows *shadows, const SkyVisibility *sky, const ChannelOutputs &out, int row0, int row1, int threads) {
    const ResolveJob job = job_of(camera, light, shadows, sky, out);
    const ResolveKernels &kernels = resolve_kernels(raster_->isa());
    raster_->draw(camera, options, row0, row1, threads, [&](const Raster::Band &band) {
        kernels.resolve(part_of(job, band, band.row0, band.row1));
    });
}

void Picture::take_smooth(Picture &finer, const RasterCamera &camera, const RasterOptions &options, const Daylight &light,
                          const SunShadows *shadows, const SkyVisibility *sky, const ChannelOutputs &out, int row0, int row1, int threads) {
    if (out.rgb == nullptr) return take(camera, options, light, shadows, sky, out, row0, row1, threads);
    raster_->check_rows(row0, row1);
    const VisibilityBuffer &b = raster_->buffer(), &f = finer.raster_->buffer();
    if (f.width != 2 * b.width || f.height != 2 * b.height) {
        throw std::invalid_argument("outlines need a picture of twice the width and twice the height");
    }
    // The rows above and below, which belong to the picture even if they are not wanted, have edges to these and colours
    // for their samples.
    const int drawn0 = std::max(row0 - kBlock, 0), drawn1 = std::min(row1 + kBlock, b.height);
    const int first = row0 / kBlock, last = ceil_div(row1, kBlock);
    centres_.resize(3 * static_cast<std::size_t>(b.width) * static_cast<std::size_t>(b.height));
    ChannelOutputs with_own_rgb = out, rgb_alone;
    with_own_rgb.rgb = rgb_alone.rgb = centres_.data();
    const ResolveJob job = job_of(camera, light, shadows, sky, with_own_rgb), beyond = job_of(camera, light, shadows, sky, rgb_alone);
    const ResolveKernels &kernels = resolve_kernels(raster_->isa());
    raster_->draw(camera, options, drawn0, drawn1, threads, [&](const Raster::Band &band) {
        kernels.resolve(part_of(beyond, band, band.row0, std::min(band.row1, first)));
        kernels.resolve(part_of(job, band, std::max(band.row0, first), std::min(band.row1, last)));
        kernels.resolve(part_of(beyond, band, std::max(band.row0, last), band.row1));
    });
    const auto line = 3 * static_cast<std::ptrdiff_t>(b.width);
    std::copy(centres_.data() + line * row0, centres_.data() + line * row1, out.rgb + line * row0);
    outlines_.find(b, drawn0, drawn1, row0, row1);
    if (outlines_.empty()) return;
    RasterOptions some = options;
    some.open = outlines_.finer_blocks(f.blocks_x, f.blocks_y).data();
    samples_.resize(3 * static_cast<std::size_t>(f.width) * static_cast<std::size_t>(f.height));
    lanes_.assign(static_cast<std::size_t>(f.blocks_x) * static_cast<std::size_t>(f.blocks_y), 0);
    ChannelOutputs colour;
    colour.rgb = samples_.data();
    ResolveJob shade = finer.job_of(camera, light, shadows, sky, colour);
    shade.lanes = lanes_.data();
    finer.raster_->draw(camera, some, 2 * row0, 2 * row1, threads, [&](const Raster::Band &band) {
        // Two rows of pixels under a row of the finer blocks.
        const int from = std::max(2 * band.row0, row0), to = std::min(2 * band.row1, row1);
        if (outlines_.match(f, from, to, lanes_.data())) kernels.resolve(finer.part_of(shade, band, band.row0, band.row1));
        outlines_.put(centres_.data(), samples_.data(), from, to, out.rgb);
    });
}

ResolveJob Picture::part_of(const ResolveJob &job, const Raster::Band &band, int row0, int row1) const {
    ResolveJob part = job;
    part.drawn = band.drawn.data();
    part.drawn_of_geom = band.drawn_of_geom.data();
    part.row0 = row0;
    part.row1 = row1;
    return part;
}

ResolveJob Picture::job_of(const RasterCamera &camera, const Daylight &light, const SunShadows *shadows, const SkyVisibility *sky,
                           const ChannelOutputs &out) const {
    ResolveJob job{};
    job.buffer = &raster_->buffer();
    job.rays = &raster_->rays();
    job.geoms = raster_->geometry().geoms().data();
    job.scenery = &scenery_;
    job.out = out;
    job.light = &light;
    if (light.clouds >= 0.0f && out.rgb != nullptr) job.pattern = &sky_pattern();
    job.shading = shading_;
    job.sky = sky;
    for (int i = 0; i < 9; ++i) job.camera_to_world[i] = static_cast<float>(camera.R_WC[i]);
    for (int i = 0; i < 3; ++i) job.p_WC[i] = static_cast<float>(camera.p_WC[i]);
    for (int c = 0; c < 3; ++c) {
        double sun = 0.0;
        for (int k = 0; k < 3; ++k) sun += camera.R_WC[3 * k + c] * light.sun_W[k];
        job.sun_C[c] = static_cast<float>(sun);
        job.up_C[c] = static_cast<float>(camera.R_WC[6 + c]);
    }
    job.pixel_angle_rad = static_cast<float>(raster_->pixel_angle_rad());
    if (shadows != nullptr && out.rgb != nullptr) shadows->fill(job, camera);
    return job;
}

}  // namespace hil::sim::frame
