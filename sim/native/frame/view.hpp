// Conservative bounds of the raster: the part of a picture that a box or a shape can touch, and its least distance.
//
// Computed in double from the camera's axes in the frame of the box. Bounds are a quarter of a pixel and 1e-5 of the
// depth larger than the shape, so that they contain every hit of the float kernels.
#pragma once

#include "geometry.hpp"
#include "raster.hpp"

namespace hil::sim::frame {

struct PixelRect {
    double lo_x, hi_x, lo_y, hi_y;  // in pixels, unclipped; pixel i covers [i, i + 1)
};

struct Columns {
    double lo = 1e300, hi = -1e300;  // in pixels
};

// Camera in a frame A: origin, axes, and the side planes of the rows that are drawn.
struct View {
    Projection projection;
    double p[3];
    double axis[3][3];   // x (right), y (down), z (forward), in A
    double side[4][3];   // pinhole: inward normals through p; parallel: inward normals, distances below
    double side_offset[4];
    double cone[4];      // table: axis in A and cosine of the half angle of the whole picture; < -1: all
    double fx, fy, cx, cy;
    double near_t, far_t;
    double near_reach_m;  // greatest distance from the camera of points that the near limit clips within the picture

    // The same camera in the frame of a geom at (p_WG, R_WG).
    View in(const double *p_AG, const double *R_AG) const;
    bool outside(const double *centre, const double *half) const;
    // Pinhole: true if a box that moves along `way` stays `pad` or more away from all that the picture can show.
    bool outside_on_its_way(const double *centre, const double *half, const double *way, double pad) const;
    // Least t of any point of the box, with margin.
    double nearest(const double *centre, const double *half) const;
    // Pixels of the part of the box in front of the camera. Returns false if every pixel may see it.
    bool pixels(const double *centre, const double *half, PixelRect &rect) const;
    // Pinhole: extends lines[i] by the columns (lo, hi) in which the box may meet lines of pixels from first + step i - reach
    // to first + step i + reach, for i in [0, count).
    void spans(const double *centre, const double *half, double first, double step, double reach, int count, Columns *lines) const;
    // Direction in A and cosine of the half angle of the box's bounding sphere.
    void cone_of(const double *centre, const double *half, float *cone) const;
};

View make_view(const RasterCamera &camera, Projection projection, double fx, double fy, double cx, double cy,
               double width, double row0, double row1, const float *cone_C, const RasterOptions &options);

// Bounds of one geom: pixels (as above) and the smallest t, tighter than those of its box for round shapes. `local`: the view
// in the geom's frame.
bool pixels_of_geom(const View &view_W, const View &local, const Geom &geom, PixelRect &rect, double &nearest);

}  // namespace hil::sim::frame
