// Rays of a camera's pixels, computed once (raster.hpp).
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "raster.hpp"

namespace hil::sim::frame {
namespace {

constexpr int kLargest = 1 << 14;  // pixels along an edge

}  // namespace

void Raster::allocate(int width, int height) {
    if (width < 1 || height < 1 || width > kLargest || height > kLargest) {
        throw std::invalid_argument("a picture has 1 to 16384 pixels along each edge");
    }
    VisibilityBuffer &b = buffer_;
    b.width = width, b.height = height;
    b.blocks_x = ceil_div(width, kBlock), b.blocks_y = ceil_div(height, kBlock);
    b.tiles_x = ceil_div(b.blocks_x, kTile), b.tiles_y = ceil_div(b.blocks_y, kTile);
    const auto blocks = static_cast<std::size_t>(b.blocks_x) * static_cast<std::size_t>(b.blocks_y);
    const auto tiles = static_cast<std::size_t>(b.tiles_x) * static_cast<std::size_t>(b.tiles_y);
    b.t.resize(16 * blocks);
    b.geom.assign(16 * blocks, -1);
    b.triangle.resize(16 * blocks);
    b.farthest.resize(blocks);
    b.tile_farthest.resize(tiles);
    b.tile_stale.resize(tiles);
}

Raster::Raster(const Geometry &geometry, int width, int height, Projection projection, double fx, double fy, double cx,
               double cy, Isa isa)
    : geometry_(geometry), isa_(isa), fx_(fx), fy_(fy), cx_(cx), cy_(cy) {
    if (!(fx > 0.0) || !(fy > 0.0) || !within_world(&fx, 1) || !within_world(&fy, 1) || !within_world(&cx, 1) || !within_world(&cy, 1)) {
        throw std::invalid_argument("focal lengths must be finite and above 0, the principal point finite");
    }
    if (projection == Projection::kTable) throw std::invalid_argument("a table of rays needs directions_C");
    allocate(width, height);
    pixel_angle_rad_ = 1.0 / fx;
    rays_.projection = projection;
    rays_.fx = static_cast<float>(fx), rays_.fy = static_cast<float>(fy);
    rays_.cx = static_cast<float>(cx), rays_.cy = static_cast<float>(cy);
    rays_.x.resize(16 * static_cast<std::size_t>(buffer_.blocks_x));
    rays_.y.resize(16 * static_cast<std::size_t>(buffer_.blocks_y));
    for (std::size_t i = 0; i < rays_.x.size(); ++i) {
        const double u = static_cast<double>(i / 16 * kBlock + i % 4) + 0.5;
        rays_.x[i] = static_cast<float>((u - cx) / fx);
    }
    for (std::size_t i = 0; i < rays_.y.size(); ++i) {
        const double v = static_cast<double>(i / 16 * kBlock + i % 16 / 4) + 0.5;
        rays_.y[i] = static_cast<float>((v - cy) / fy);
    }
    rays_.first_y.resize(rays_.y.size() / 16 + 16);
    rays_.last_y.resize(rays_.y.size() / 16 + 16);
    for (std::size_t row = 0; row < rays_.y.size() / 16; ++row) {
        rays_.first_y[row] = rays_.y[16 * row];
        rays_.last_y[row] = rays_.y[16 * row + 15];
    }
}

Raster::Raster(const Geometry &geometry, int width, int height, const double *directions_C, Isa isa)
    : geometry_(geometry), isa_(isa) {
    allocate(width, height);
    rays_.projection = Projection::kTable;
    const VisibilityBuffer &b = buffer_;
    const auto at = [&](int x, int y, double *d) {
        x = std::min(x, width - 1), y = std::min(y, height - 1);
        const double *from = directions_C + 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x));
        std::copy_n(from, 3, d);
    };
    // Cone of a rectangle of pixels: its axis is the mean direction, its half angle that of the farthest pixel.
    const auto cone = [&](int x0, int y0, int columns, int rows, float *to) {
        double sum[3] = {}, d[3];
        for (int y = y0; y < y0 + rows; ++y) {
            for (int x = x0; x < x0 + columns; ++x) {
                at(x, y, d);
                for (int i = 0; i < 3; ++i) sum[i] += d[i];
            }
        }
        const double length = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
        double least = 2.0;
        for (int y = y0; y < y0 + rows; ++y) {
            for (int x = x0; x < x0 + columns; ++x) {
                at(x, y, d);
                least = std::min(least, (d[0] * sum[0] + d[1] * sum[1] + d[2] * sum[2]) / length);
            }
        }
        for (int i = 0; i < 3; ++i) to[i] = length > 0.0 ? static_cast<float>(sum[i] / length) : 0.0f;
        to[3] = length > 1e-9 ? static_cast<float>(least - 1e-6) : -2.0f;
    };
    rays_.xyz.resize(3 * buffer_.t.size());
    rays_.block_cone.resize(4 * buffer_.farthest.size());
    rays_.tile_cone.resize(4 * buffer_.tile_farthest.size());
    for (int row = 0; row < b.blocks_y; ++row) {
        for (int column = 0; column < b.blocks_x; ++column) {
            const auto block = static_cast<std::size_t>(row * b.blocks_x + column);
            for (int lane = 0; lane < 16; ++lane) {
                double d[3];
                at(kBlock * column + lane % 4, kBlock * row + lane / 4, d);
                if (!within_world(d, 3)) throw std::invalid_argument("a ray direction of the camera is not finite");
                for (std::size_t i = 0; i < 3; ++i) {
                    rays_.xyz[48 * block + 16 * i + static_cast<std::size_t>(lane)] = static_cast<float>(d[i]);
                }
            }
            cone(kBlock * column, kBlock * row, kBlock, kBlock, &rays_.block_cone[4 * block]);
        }
    }
    for (int row = 0; row < b.tiles_y; ++row) {
        for (int column = 0; column < b.tiles_x; ++column) {
            const auto tile = static_cast<std::size_t>(row * b.tiles_x + column);
            cone(kBlock * kTile * column, kBlock * kTile * row, kBlock * kTile, kBlock * kTile, &rays_.tile_cone[4 * tile]);
        }
    }
    cone(0, 0, width, height, rays_.cone);
    double a[3], c[3];
    at(width / 2, height / 2, a);
    at(width / 2 + 1, height / 2, c);
    const double across = std::sqrt((c[0] - a[0]) * (c[0] - a[0]) + (c[1] - a[1]) * (c[1] - a[1]) + (c[2] - a[2]) * (c[2] - a[2]));
    if (across > 1e-9) pixel_angle_rad_ = across;
}

}  // namespace hil::sim::frame
