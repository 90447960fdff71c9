// Camera: draws the visibility buffer, then resolves the requested channels, with the sun's shadows.
#pragma once

#include <memory>
#include <vector>

#include "outlines.hpp"
#include "raster.hpp"
#include "resolve.hpp"

namespace hil::sim::frame {

// Shadow maps of the sun. Static geoms are drawn once, moving ones after each move, if a picture can show their shadows.
class SunShadows {
public:
    // `resolution`: pixels along the longer edge of the finite static geoms. Throws std::invalid_argument for a sun at
    // or below the horizon.
    SunShadows(const Geometry &geometry, const float *sun_W, int resolution, Isa isa);

    // Draws what has moved: all, but for a pinhole `picture` taken at `camera` at least the moving geoms whose shadows it can
    // show. Both may be null.
    void update(bool reuse_static, const Raster *picture, const RasterCamera *camera);
    // Writes to `job` how a camera at `camera` reads the maps.
    void fill(ResolveJob &job, const RasterCamera &camera) const;

private:
    struct Map {
        std::unique_ptr<Raster> raster;
        const Raster::Band *band = nullptr;
        std::uint64_t version = ~std::uint64_t{0};
        std::vector<std::int32_t> sole;  // as in ShadowMap
        int area_power = 0;
    };
    void draw(Map &map, const RasterOptions &options);
    static void note_sole(Map &map, bool sparse);
    bool add_casters(const Raster *picture, const RasterCamera *camera);
    const Geometry &geometry_;
    RasterCamera camera_{};
    double pixels_per_m_ = 1.0;
    double lowest_m_ = 0.0;  // in W: no static geom is lower
    Map static_, moving_;
    std::vector<std::uint8_t> casters_;  // [Geometry::moving()]: 1 if drawn in `moving_`
};

class Picture {
public:
    Picture(std::unique_ptr<Raster> raster, const Scenery &scenery, const Shading &shading)
        : raster_(std::move(raster)), scenery_(scenery), shading_(shading) {}

    // Fills the outputs that are not null. `shadows` and `sky` may be null. Not thread-safe.
    void take(const RasterCamera &camera, const RasterOptions &options, const Daylight &light, const SunShadows *shadows,
              const SkyVisibility *sky, const ChannelOutputs &out, int row0, int row1, int threads);

    // The same, with the outlines of `rgb` smoothed (outlines.hpp) by samples of `finer`: the same camera and geometry with
    // twice the pixels along each edge. Throws std::invalid_argument for a picture of another size. Not thread-safe.
    void take_smooth(Picture &finer, const RasterCamera &camera, const RasterOptions &options, const Daylight &light,
                     const SunShadows *shadows, const SkyVisibility *sky, const ChannelOutputs &out, int row0, int row1, int threads);

    const Raster &raster() const { return *raster_; }

private:
    ResolveJob job_of(const RasterCamera &camera, const Daylight &light, const SunShadows *shadows, const SkyVisibility *sky,
                      const ChannelOutputs &out) const;
    ResolveJob part_of(const ResolveJob &job, const Raster::Band &band, int row0, int row1) const;  // block rows

    std::unique_ptr<Raster> raster_;
    const Scenery &scenery_;
    Shading shading_;
    Outlines outlines_;
    std::vector<std::uint8_t> centres_, samples_;  // colour of this picture, of the finer one
    std::vector<std::uint16_t> lanes_;             // of the finer picture, as in ResolveJob
};

}  // namespace hil::sim::frame
