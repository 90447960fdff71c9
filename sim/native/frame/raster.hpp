// The visibility buffer: which geom each pixel sees, and how far away, exact to rounding for every primitive.
//
// No triangles are made of spheres, capsules, ellipsoids, cylinders, boxes and planes: each pixel's ray meets the shape
// itself (shapes.hpp), 16 pixels at a time. Geoms are drawn nearest first; a block of 4 x 4 pixels remembers its
// farthest depth, so what lies behind is left out block by block, and whole branches of the tree at once.
//
// What a pixel sees is the least t, of equal ones the geom (then the triangle) of lower index: a function of the
// pixel's ray and the geoms alone. So the picture does not depend on the order of drawing, on what was culled, on the
// number of threads (each has rows of its own) or on the instruction set.
//
// Rays. Camera frame C: x right, y down, z forward; the ray of a pixel is d_C, and t its parameter. Pinhole:
// d_C = ((u - cx) / fx, (v - cy) / fy, 1), t is the planar depth. Any other camera brings a table of unit d_C, t is the
// range. Parallel (for shadow maps): d_C = (0, 0, 1), the origin moves in x and y.
//
// Blocks: pixel (x, y) is lane 4 (y % 4) + x % 4 of block (x / 4, y / 4). Not thread-safe; no allocation in `draw`
// once the largest scene was seen.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "geometry.hpp"
#include "isa.hpp"

namespace hil::sim::frame {

constexpr int kBlock = 4, kTile = 8;  // edges of a block in pixels, of a tile in blocks
inline int ceil_div(int a, int b) { return (a + b - 1) / b; }

enum class Projection { kPinhole, kTable, kParallel };

struct RasterCamera {
    double p_WC[3];
    double R_WC[9];
    double v_W[3];  // velocity of the camera's origin; its own turning moves no point along a ray
};

struct RasterOptions {
    float near_t = 0.05f, far_t = 10000.0f;
    bool frustum_culling = true;
    bool occlusion_culling = true;
    bool hide_backs = true;  // of closed meshes seen from outside
    // Which geoms are drawn.
    bool draw_static = true, draw_moving = true;
    // Clear only what the picture before has touched: for pictures of a few moving geoms. Only without occlusion culling,
    // in one thread, and always the whole picture.
    bool sparse = false;
};

struct RasterCounts {  // of the last picture
    std::int64_t nodes = 0, geoms = 0;
};

// What the kernels need of one geom in one picture. Local frame: the geom's, divided by the semi-axes for ellipsoids.
struct DrawnGeom {
    std::int32_t geom;
    Shape shape;
    float m[9];    // C into local
    float o[3];    // camera origin in local
    float half[3];
    float radius;
    float t_min_bound;         // no point of it is nearer
    std::int32_t x0, x1, y0, y1;  // blocks it may touch, ends excluded
    float cone[4];             // table: direction of its bounding sphere in C and cosine of its half angle; < -1: all
    float velocity_C[3];       // of the point of its rigid body at the camera's origin, relative to the camera
    const Mesh *mesh;
    bool backs_hidden;         // a closed mesh seen from outside
};

// Pixels of one picture, in blocks.
struct VisibilityBuffer {
    int width = 0, height = 0, blocks_x = 0, blocks_y = 0, tiles_x = 0, tiles_y = 0;
    std::vector<float> t;              // [blocks][16]
    std::vector<std::int32_t> geom;    // [blocks][16], -1: nothing
    std::vector<std::int32_t> triangle;  // [blocks][16], of a mesh
    std::vector<float> farthest;       // [blocks]
    std::vector<float> tile_farthest;  // [tiles], 8 x 8 blocks
    std::vector<std::uint8_t> tile_stale;
};

// Ray directions as the kernels read them.
struct RayTable {
    Projection projection = Projection::kPinhole;
    std::vector<float> x, y;      // pinhole, parallel: [blocks_x][16] and [blocks_y][16]
    std::vector<float> xyz;       // table: [blocks][3][16]
    std::vector<float> tile_cone, block_cone;  // table: axis and cosine of the half angle [.][4]
    float cone[4] = {0, 0, 0, -2};             // table: of the whole picture
    float fx = 1, fy = 1, cx = 0, cy = 0;      // pinhole, parallel
};

// Kernels of one instruction set.
struct RasterKernels {
    // Draws one geom into block rows [row0, row1). `packets` (meshes): which packets of triangles.
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

    // Block rows that one thread draws, and what it drew there.
    struct Band {
        int row0 = 0, row1 = 0;
        std::vector<DrawnGeom> drawn;
        std::vector<std::int32_t> drawn_of_geom;  // valid for geoms that are in the buffer
        std::vector<std::pair<float, std::int32_t>> heap;
        std::vector<std::int32_t> packets;
        RasterCounts counts;
    };

    // Pixel rows [row0, row1) anew; row0 and row1 are multiples of 4 or the height. `threads` >= 1; each calls `then`
    // with its rows when they are drawn. A camera pose that is not finite sees nothing.
    void draw(const RasterCamera &camera, const RasterOptions &options, int row0, int row1, int threads,
              const std::function<void(const Band &)> &then);

    const VisibilityBuffer &buffer() const { return buffer_; }
    const RayTable &rays() const { return rays_; }
    const Geometry &geometry() const { return geometry_; }
    const RasterCounts &counts() const { return counts_; }
    Isa isa() const { return isa_; }
    double pixel_angle_rad() const { return pixel_angle_rad_; }  // of one pixel, in the middle of the picture

private:
    void allocate(int width, int height);
    void clear(const Band &band, const RasterOptions &options);
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
