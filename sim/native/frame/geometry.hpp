// Scene as exteroceptive sensors see it: geoms with their poses and velocities, meshes, and the trees over them.
//
// Static geoms are in one tree over world boxes, built once. Each moving geom has a world box, updated by `move`.
// Infinite planes, invisible geoms and geoms without a finite pose or box are in no tree.
// World frame W [m]; G is a geom's own frame; sizes are MuJoCo's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "bvh.hpp"

namespace hil::sim::frame {

// Returns true if all values are below 1e7 in magnitude and none is NaN. A pose with other values counts as not finite.
bool within_world(const double *x, int n);

enum class Shape : std::uint8_t { kPlane = 0, kSphere = 2, kCapsule = 3, kEllipsoid = 4, kCylinder = 5, kBox = 6, kMesh = 7 };

// One triangle as pictures are shaded with it. Each row of four gives a value at the point p of the mesh: c[0..2] . p + c[3].
struct Facet {
    float normal[4];     // the unit normal, and the plane's offset: gives the distance from the plane. Zero without area
    float u[4], v[4];    // texture coordinates; zero without
    float smooth[3][4];  // interpolated corner normals; zero without
};

// Triangles in the frame of the geoms that use them, with a tree over them.
struct Mesh {
    std::vector<float> vertex;           // [vertices][3]
    std::vector<std::int32_t> triangle;  // [triangles][3], into `vertex`
    std::vector<float> uv;               // [triangles][3][2], or empty
    std::vector<float> corner_normal;    // [triangles][3][3], or empty: flat
    float uv_per_m = 1.0f;               // texture coordinates per metre of surface, on average
    Bvh tree;
    Aabb box;
    // The same triangles in packets of 16 for the raster: [packets][corner][x y z][16], and a tree over the packets.
    // The last packet is padded with its last triangle.
    std::vector<float> packed;
    std::vector<Facet> facet;  // [triangles]
    // [triangles]: one triangle of those that share its plane and its map of texture coordinates, the largest; normals and
    // coordinates of a flat mesh are computed once for all of them. With corner normals each triangle is its own.
    std::vector<std::int32_t> face;
    Bvh packed_tree;
    // True if every edge belongs to two triangles that traverse it in opposite directions, and every connected part
    // faces outwards. From outside, no ray then meets the back of a triangle first, but for rounding where front and back
    // are close.
    bool closed = false;
    float edge_m = 0.0f;  // edge of a square of twice the mean area of the triangles
};

// Holes of a mesh: a surface point exists only where the texel under it is opaque. The finest level decides at any
// distance, so that a pixel or a ray meets the mask exactly, and the share of hits is the share of opaque texels.
// Edges are powers of two, at least 4; the mask repeats. Row 0 is at v = 1.
struct AlphaMask {
    int width = 0, height = 0;
    std::vector<std::int32_t> opaque;  // bit 0 of word 0 is the first texel of row 0
};

struct Geom {
    Shape shape;
    bool moving = false, visible = true;
    std::uint8_t class_id = 0, surface = 0;
    std::uint16_t instance = 0;
    std::int32_t mesh = -1, mask = -1;  // mask: of a mesh with texture coordinates
    double size[3];
    double p_WG[3];
    double R_WG[9];   // row-major, G into W
    double v_W[3];    // of G's origin
    double w_W[3];
    double centre[3];  // of the local box, in G
    double half[3];    // its half extents; infinite for an infinite plane
};

class Geometry {
public:
    // Add meshes first, then geoms, then call `finish`; nothing can be added after it. Indices count in the order of
    // adding. Throws std::invalid_argument for an unknown vertex, mesh or mask index, for a mask whose edges are not powers
    // of two, for a mask on a geom without texture coordinates, and for additions after `finish`.
    int add_mesh(const float *vertex, std::size_t vertices, const std::int32_t *triangle, std::size_t triangles,
                 const float *uv, const float *corner_normal);
    int add_mask(const std::uint8_t *opaque, std::size_t height, std::size_t width);
    int add_geom(const Geom &geom);  // centre, half, v_W, w_W are filled in here
    void finish();

    // Sets pose and velocity of a moving geom. A pose that is not finite hides it until the next one. Throws
    // std::invalid_argument for a static geom.
    void move(int index, const double *p_WG, const double *R_WG, const double *v_W, const double *w_W);

    // Hides a moving geom until `move` is called for it.
    void hide(int index);

    const std::vector<Mesh> &meshes() const { return meshes_; }
    const std::vector<AlphaMask> &masks() const { return masks_; }
    const std::vector<Geom> &geoms() const { return geoms_; }
    const Bvh &tree() const { return tree_; }                                // over static geoms; items are geoms
    const std::vector<std::int32_t> &unbounded() const { return unbounded_; }  // infinite planes, static
    const std::vector<std::int32_t> &moving() const { return moving_; }
    const Aabb &world_box(int geom) const { return boxes_[static_cast<std::size_t>(geom)]; }
    bool shown(int geom) const { return shown_[static_cast<std::size_t>(geom)] != 0; }
    std::uint64_t version() const { return version_; }  // counts moves

private:
    void place(int index);
    Geom &moving_geom(int index);

    std::vector<Mesh> meshes_;
    std::vector<AlphaMask> masks_;
    std::vector<Geom> geoms_;
    Bvh tree_;
    std::vector<std::int32_t> unbounded_, moving_;
    std::vector<Aabb> boxes_;
    std::vector<std::uint8_t> shown_;
    std::uint64_t version_ = 0;
    bool finished_ = false;
};

}  // namespace hil::sim::frame
