// Ray casting against a Geometry in double precision: for LiDAR, and as the reference for faster renderers.
//
// For each ray p(t) = o + t d: the nearest t in [t_min, t_max] at which it hits a surface, and the geom. Surfaces are
// those of mj_ray: planes are hit from above only, solids from within where the ray leaves them, triangles from either
// side; invisible geoms are ignored, and so are the holes of masks (AlphaMask). With equal t, the hit with the smaller
// geom index counts, then triangle index, so the result depends only on the rays and the scene, not on the tree, the
// grouping, the threads or the CPU.
//
// Method: rays are sorted by direction and taken eight at a time, in groups of eight such packets. Their common beam
// (bounds of origins and directions) traverses a tree with eight boxes a node, near to far. Shapes are intersected with
// eight rays at once (shapes.hpp), triangles eight at once with each ray that enters their box. A beam skips nodes
// behind the farthest hit that it still needs.
//
// Outputs are caller-owned. Call `refresh` after the geometry moved. `cast` is const and may run in several threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "geometry.hpp"
#include "isa.hpp"
#include "wide_tree.hpp"

namespace hil::sim::frame {

// Geom as the kernel reads it.
struct CastGeom {
    double p_WG[3], R_WG[9];
    float lo[3], hi[3];  // box in W, padded as the boxes of the trees are
    double size[3];
    double inverse_size[3];  // ellipsoids
    std::int32_t mesh, mask;  // mask -1: no holes
    Shape shape;
    bool shown;
};

// Leaf of a mesh's tree: up to eight triangles, lane by lane. Lanes beyond `count` repeat the last one.
struct alignas(64) TriangleBlock {
    float corner[3][3][kWide];  // [corner][x y z]
    float lo[3], hi[3];         // padded as the boxes of the tree are
    std::int32_t first, count;  // triangles of the mesh
};

struct CastMesh {
    const WideNode *nodes;  // items are blocks
    const TriangleBlock *blocks;
    std::int32_t block_count;
    float lo[3], hi[3];
    const float *vertex;           // [vertices][3]
    const std::int32_t *triangle;  // [triangles][3], into `vertex`
    const float *uv;               // [triangles][3][2], or null
};

struct CastScene {
    const WideNode *fixed, *moving;  // null: no such geoms
    const std::int32_t *unbounded;
    const CastGeom *geoms;
    const CastMesh *meshes;
    const AlphaMask *masks;
    std::int32_t unbounded_count, geom_count;
    int stack_entries;  // needed by a traversal, including that of a mesh within it
};

// Shortcuts that do not change the result; each can be switched off separately.
struct CastSkips {
    bool tree = true;       // false: every geom and triangle is tested
    bool max_range = true;  // false: hits beyond t_max are computed, then dropped
};

struct RayBatch {
    const double *origin;        // [count][3], or [3] for all [m, W]
    bool one_origin;
    const double *direction;     // [count][3]; t is in units of its length
    const std::int32_t *order;   // [count] indices of rays in processing order
    double t_min, t_max;
    CastSkips skips;
    double *range;               // [count] t, +inf without a hit
    std::int32_t *geom;          // [count] -1 without a hit
    double *normal;              // [count][3] unit, against the ray; zeros without a hit. May be null
};

struct StackEntry {
    double near;
    std::int32_t child;
};

// Casts the rays at positions [begin, end) of `order`; begin is a multiple of eight. `stack` has scene.stack_entries.
using CastKernel = void (*)(const CastScene &scene, const RayBatch &rays, std::size_t begin, std::size_t end,
                            StackEntry *stack);
namespace base {
void cast_packets(const CastScene &, const RayBatch &, std::size_t, std::size_t, StackEntry *);
}
#if defined(__x86_64__)
namespace avx2 {
void cast_packets(const CastScene &, const RayBatch &, std::size_t, std::size_t, StackEntry *);
}
namespace avx512 {
void cast_packets(const CastScene &, const RayBatch &, std::size_t, std::size_t, StackEntry *);
}
#endif
CastKernel cast_kernel(Isa isa);

struct CastOutput {
    double *range;            // [count]
    std::int32_t *geom;       // [count]
    double *normal;           // [count][3] unit, against the ray; zeros without a hit. May be null
    double *radial_velocity;  // [count] [m/s] of the surface point along the ray, + = receding, NaN without a hit. May be null
};

class RayCaster {
  public:
    // The geometry must outlive the caster and be finished. Static geoms are prepared here, once.
    explicit RayCaster(const Geometry &geometry);

    // Copies the poses of moving geoms; does nothing if none has moved since.
    void refresh();

    // Casts `count` rays; origin is [count][3] or, with one_origin, [3]. Rays that are not finite, have no direction or
    // start beyond 1e7 m hit nothing, nor does any ray if t_min or t_max is NaN or t_max < t_min; t_min < 0 counts as 0.
    // `order`: a permutation from `coherent_order`, to save the sorting for rays that are cast repeatedly; affects speed
    // only. Null: sorted here.
    void cast(const double *origin, bool one_origin, const double *direction, std::size_t count, double t_min,
              double t_max, const CastSkips &skips, const std::int32_t *order, int threads, Isa isa,
              const CastOutput &out) const;

  private:
    CastScene scene() const;

    const Geometry &geometry_;
    std::vector<CastGeom> geoms_;
    std::vector<CastMesh> meshes_;
    std::vector<WideTree> mesh_trees_;
    std::vector<std::vector<TriangleBlock>> blocks_;  // by mesh
    std::vector<Aabb> boxes_;  // by geom
    WideTree fixed_, moving_;
    double moving_area_ = 0.0;
    std::uint64_t version_ = 0;
    bool fresh_ = false;
};

// Writes to `order` [count] a permutation in which neighbours have similar directions: cells of a cube map along a
// Morton curve, by a stable sort. Directions that are NaN come last.
void coherent_order(const double *direction, std::size_t count, std::int32_t *order);

}  // namespace hil::sim::frame
