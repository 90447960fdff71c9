// Visibility buffer: the geom that each pixel sees, and its distance, exact to rounding for every primitive.
//
// Spheres, capsules, ellipsoids, cylinders, boxes and planes are not converted to triangles: each pixel's ray is
// intersected with the shape itself (shapes.hpp), 16 pixels at a time. Geoms are drawn nearest first. A block of 4 x 4
// pixels stores its farthest depth, so that hidden geoms and whole branches of the tree are skipped block by block.
//
// A pixel sees the hit with the smallest t; with equal t, the one with the smaller geom index, then triangle index. A hit
// that rounding puts before the lower bound of its geom or triangle counts at the bound.
// This depends only on the pixel's ray and the geoms, so the picture does not depend on the order of drawing, on
// culling but for `hide_backs`, on the number of threads (each draws its own rows) or on the instruction set.
//
// Rays. Camera frame C: x right, y down, z forward; the ray of a pixel is d_C, and t its parameter. Pinhole:
// d_C = ((u - cx) / fx, (v - cy) / fy, 1), t is the planar depth. Other cameras: a table of unit d_C, t is the
// range. Parallel (for shadow maps): d_C = (0, 0, 1), the origin moves in x and y.
//
// Blocks: pixel (x, y) is lane 4 (y % 4) + x % 4 of block (x / 4, y / 4). Not thread-safe. `draw` allocates only when a
// scene is larger than all before.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "geometry.hpp"
#include "isa.hpp"

namespace hil::sim::frame {

constexpr int kBlock = 4, kTile = 8;  // edges of a block in pixels, of a tile in blocks
constexpr int kFewBlocks = 4;         // a mesh that touches no more is tested by the rays of all their pixels
inline int ceil_div(int a, int b) { return (a + b - 1) / b; }

enum class Projection { kPinhole, kTable, kParallel };

struct RasterCamera {
    double p_WC[3];
    double R_WC[9];
    double v_W[3];  // velocity of the camera's origin; the camera's rotation has no effect along a ray
};

struct RasterOptions {
    float near_t = 0.05f, far_t = 10000.0f;
    bool frustum_culling = true;
    bool occlusion_culling = true;
    bool hide_backs = true;  // skip back faces of closed meshes seen from outside
    bool draw_static = true, draw_moving = true;
    // Clear only what the previous picture has touched, for pictures of a few moving geoms. Needs one thread, the whole
    // picture and no occlusion culling.
    bool sparse = false;
    // [blocks]: nothing is seen in those of value 0, and geoms there need no drawing; their pixels are undefined. Null: all.
    const std::uint8_t *open = nullptr;
    const std::uint8_t *moving = nullptr;  // [Geometry::moving()]: those of value 0 are not drawn; null: all
};

struct View;

struct RasterCounts {  // of the last picture
    std::int64_t nodes = 0, geoms = 0;
};

// One geom in one picture, as the kernels read it. Local frame: the geom's, divided by the semi-axes for ellipsoids.
struct DrawnGeom {
    std::int32_t geom;
    Shape shape;
    float m[9];    // C into local
    float o[3];    // camera origin in local
    float half[3];
    float radius;
    float t_min_bound;         // lower bound of t over the geom; a hit that rounding puts before it is moved to it
    std::int32_t x0, x1, y0, y1;  // blocks it may touch, ends excluded
    float cone[4];             // table: cone of its bounding sphere, axis in C and cosine of the half angle; < -1: all
    // Velocity, relative to the camera, that its rigid body would have at the camera's origin if it extended to there.
    float velocity_C[3];
    const std::int32_t *spans;  // of a box: first and last column of each block row from y0 on, end excluded; null: x0 to x1
    const Mesh *mesh;
    const AlphaMask *mask;     // null: no holes
    bool backs_hidden;         // back faces are skipped
    bool first;                // an infinite plane that is drawn before all others, into blocks that hold anything
};

// Pixels of one picture, in blocks.
struct VisibilityBuffer {
    int width = 0, height = 0, blocks_x = 0, blocks_y = 0, tiles_x = 0, tiles_y = 0;
    std::vector<float> t;              // [blocks][16]
    std::vector<std::int32_t> geom;    // [blocks][16], -1: nothing
    std::vector<std::int32_t> triangle;  // [blocks][16], of a mesh
    std::vector<float> farthest;       // [blocks]; -inf: closed (RasterOptions::open)
    std::vector<float> tile_farthest;  // [tiles], 8 x 8 blocks
    std::vector<std::uint8_t> tile_stale;
};

// Ray directions as the kernels read them.
struct RayTable {
    Projection projection = Projection::kPinhole;
    std::vector<float> x, y;      // pinhole, parallel: [blocks_x][16] and [blocks_y][16]
    std::vector<float> first_y, last_y;  // the same y of the first and the last line of each block row, and 16 more
    std::vector<float> xyz;       // table: [blocks][3][16]
    std::vector<float> tile_cone, block_cone;  // table: axis and cosine of the half angle [.][4]
    float cone[4] = {0, 0, 0, -2};             // table: of the whole picture
    float fx = 1, fy = 1, cx = 0, cy = 0;      // pinhole, parallel
};

// Kernels of one instruction set.
struct RasterKernels {
    // Draws one geom into block rows [row0, row1). `packets`: indices of the triangle packets of a mesh to draw.
    void (*draw)(const DrawnGeom &, const RayTable &, VisibilityBuffer &, const RasterOptions &, int row0, int row1,
                 const std::int32_t *packets, int packet_count);
};
const RasterKernels &raster_kernels(Isa isa);

class Raster {
public:
    // Pinhole or parallel: pixels per unit of direction or of length, principal point in pixels.
    Raster(const Geometry &geometry, int width, int height, Projection projection, double fx, double fy, double cx,
           double cy, Isa isa = best_isa());
    // Table: unit directions [height][width][3] in C.
    Raster(const Geometry &geometry, int width, int height, const double *directions_C, Isa isa = best_isa());

    // Block rows of one thread, and its results there.
    struct Band {
        int row0 = 0, row1 = 0;
        std::vector<DrawnGeom> drawn;
        std::vector<std::int32_t> drawn_of_geom;  // valid for geoms that are in the buffer
        std::vector<std::pair<float, std::int32_t>> heap;
        std::vector<std::int32_t> packets;
        RasterCounts counts;
    };

    // Draws pixel rows [row0, row1); row0 and row1 are multiples of 4 or the height. Each of `threads` >= 1 threads
    // calls `then` with its rows after it has drawn them. A camera with a pose that is not finite sees nothing.
    void draw(const RasterCamera &camera, const RasterOptions &options, int row0, int row1, int threads,
              const std::function<void(const Band &)> &then);

    View view(const RasterCamera &camera, const RasterOptions &options, int row0, int row1) const;  // of these block rows

    void check_rows(int row0, int row1) const;  // throws std::invalid_argument for rows that `draw` does not take

    const VisibilityBuffer &buffer() const { return buffer_; }
    const RayTable &rays() const { return rays_; }
    const Geometry &geometry() const { return geometry_; }
    const RasterCounts &counts() const { return counts_; }
    Isa isa() const { return isa_; }
    double pixel_angle_rad() const { return pixel_angle_rad_; }  // of one pixel, in the middle of the picture

private:
    void allocate(int width, int height);
    void clear(const Band &band, const RasterOptions &options, bool by_plane);  // by_plane: leaves the pixels to the first plane
    void blank_open(int row, const RasterOptions &options);
    bool plane_clears(const RasterOptions &options) const;
    void draw_band(Band &band, const RasterCamera &camera, const RasterOptions &options);

    const Geometry &geometry_;
    Isa isa_;
    double fx_ = 1, fy_ = 1, cx_ = 0, cy_ = 0, pixel_angle_rad_ = 1e-3;
    VisibilityBuffer buffer_;
    RayTable rays_;
    RasterCounts counts_;
    std::vector<Band> bands_;
    bool cleared_ = false;
};

}  // namespace hil::sim::frame
