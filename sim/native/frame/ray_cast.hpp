// Rays against a Geometry in double precision: LiDAR, and the reference for whatever draws the same scene faster.
//
// For each ray p(t) = o + t d the nearest t in [t_min, t_max] at which it meets a surface, and whose. Surfaces are
// those of mj_ray: planes from above only, solids from within where the ray leaves them, triangles from either side;
// invisible geoms do not exist. Of geoms met at the same t the one of lower index counts, of triangles likewise, so
// the result is a function of the rays and the scene alone: not of the tree, the grouping, the threads or the CPU.
//
// How. Rays are sorted by direction and taken eight at a time, four such packets side by side. Their common beam (bounds
// of origins and directions) walks a tree of eight boxes a node, near to far, one node a few instructions; shapes are met
// by eight rays at once (shapes.hpp), triangles eight at once by each ray that enters their box. A beam drops whatever
// lies behind the farthest hit it still needs.
//
// Outputs are the caller's. `refresh` after the geometry moved; `cast` is const and may run in several threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "geometry.hpp"
#include "isa.hpp"
#include "wide_tree.hpp"

namespace hil::sim::frame {

// A geom as the kernel wants it.
struct CastGeom {
    double p_WG[3], R_WG[9];
    double size[3];
    double inverse_size[3];  // ellipsoids
    std::int32_t mesh;
    Shape shape;
    bool shown;
};

// Up to eight triangles side by side: a leaf of a mesh's tree. Places beyond `count` repeat the last one.
struct alignas(64) TriangleBlock {
    float corner[3][3][kWide];  // [corner][x y z]
    float lo[3], hi[3];         // padded like the boxes of the tree
    std::int32_t first, count;  // triangles of the mesh
};

struct CastMesh {
    const WideNode *nodes;  // items are blocks
    const TriangleBlock *blocks;
    std::int32_t block_count;
    float lo[3], hi[3];
    const float *vertex;           // [vertices][3]
    const std::int32_t *triangle;  // [triangles][3], into `vertex`
};

struct CastScene {
    const WideNode *fixed, *moving;  // null: nothing there
    const std::int32_t *unbounded;
    const CastGeom *geoms;
    const CastMesh *meshes;
    std::int32_t unbounded_count, geom_count;
    int stack_entries;  // that a walk needs, a mesh's within it included
};

// What can be left out without changing the result; each can be switched on its own.
struct CastSkips {
    bool tree = true;       // only what the beam's boxes reach, instead of every geom and triangle
    bool max_range = true;  // nothing beyond t_max is looked at, instead of looked at and dropped
};

struct RayBatch {
    const double *origin;        // [count][3], or [3] for all [m, W]
    bool one_origin;
    const double *direction;     // [count][3]; t counts in its length
    const std::int32_t *order;   // [count] rays in the order they are taken
    double t_min, t_max;
    CastSkips skips;
    double *range;               // [count] t, +inf where nothing is met
    std::int32_t *geom;          // [count] -1 where nothing is met
    double *normal;              // [count][3] unit, against the ray; zeros where nothing is met. May be null
};

struct StackEntry {
    double near;
    std::int32_t child;
};

// Positions [begin, end) of `order`; begin is a multiple of eight. `stack` has scene.stack_entries.
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
    double *normal;           // [count][3] unit, against the ray; zeros where nothing is met. May be null
    double *radial_velocity;  // [count] [m/s] of the surface point along the ray, + = receding; NaN: nothing. Or null
};

class RayCaster {
  public:
    // The geometry must outlive the caster and be finished; what does not move is prepared here, once.
    explicit RayCaster(const Geometry &geometry);

    // Take over the poses of what moves; does nothing if nothing moved since.
    void refresh();

    // `count` rays; origin [count][3] or, with one_origin, [3]. Rays that are not finite, have no direction or start
    // farther out than 1e7 m meet nothing, nor does any if t_min or t_max is NaN or t_max < t_min; t_min < 0 is 0.
    // `order`, a permutation such as `coherent_order` gives, spares its sorting for rays that come again and again
    // (speed alone); null: sorted here.
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

// Directions into an order in which neighbours look the same way: cells of a cube map along a Morton curve, stable.
// Directions that are no numbers go last. `order` holds `count`.
void coherent_order(const double *direction, std::size_t count, std::int32_t *order);

}  // namespace hil::sim::frame
