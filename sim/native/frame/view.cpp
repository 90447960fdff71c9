#include "view.hpp"

#include <algorithm>
#include <cmath>

namespace hil::sim::frame {

namespace {

double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

double reach(const double *axis, const double *half) {
    return std::fabs(axis[0]) * half[0] + std::fabs(axis[1]) * half[1] + std::fabs(axis[2]) * half[2];
}

double with_margin(double t) { return t - 1e-5 * std::fabs(t) - 1e-5; }

double sum_of_sizes(const double *v) { return std::fabs(v[0]) + std::fabs(v[1]) + std::fabs(v[2]); }

void transposed_times(const double *R, const double *v, double *to) {
    for (int i = 0; i < 3; ++i) to[i] = R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2];
}

struct Range {
    double lo, hi;
    void take(double x) {
        lo = std::min(lo, x);
        hi = std::max(hi, x);
    }
};
constexpr Range kNothing{1e300, -1e300};

// Bounds of the image of the ellipsoid (x - c)' A^-1 (x - c) = 1, wholly in front of the camera: with the dual conic
// C = c c' - A, the least and greatest x are (C13 -+ sqrt(C13^2 - C33 C11)) / C33; likewise y. (Hartley and Zisserman,
// Multiple View Geometry, ch. 8.)
bool quadric_bounds(const double *c, double a11, double a13, double a22, double a23, double a33, Range &x, Range &y) {
    const double c33 = c[2] * c[2] - a33;
    if (!(c[2] > 0.0) || !(c33 > 1e-12)) return false;
    const double c13 = c[0] * c[2] - a13, c11 = c[0] * c[0] - a11, c23 = c[1] * c[2] - a23, c22 = c[1] * c[1] - a22;
    const double sx = std::sqrt(std::max(0.0, c13 * c13 - c33 * c11)), sy = std::sqrt(std::max(0.0, c23 * c23 - c33 * c22));
    x.take((c13 - sx) / c33);
    x.take((c13 + sx) / c33);
    y.take((c23 - sy) / c33);
    y.take((c23 + sy) / c33);
    return true;
}

}  // namespace

View make_view(const RasterCamera &camera, Projection projection, double fx, double fy, double cx, double cy,
               double width, double row0, double row1, const float *cone_C, const RasterOptions &options) {
    View v{};
    v.projection = projection;
    v.fx = fx, v.fy = fy, v.cx = cx, v.cy = cy;
    v.near_t = options.near_t, v.far_t = options.far_t;
    for (int i = 0; i < 3; ++i) {
        v.p[i] = camera.p_WC[i];
        for (int k = 0; k < 3; ++k) v.axis[k][i] = camera.R_WC[3 * i + k];
    }
    const double left = -cx / fx, right = (width - cx) / fx, top = (row0 - cy) / fy, bottom = (row1 - cy) / fy;
    const double across = std::max(std::fabs(left), std::fabs(right)), along = std::max(std::fabs(top), std::fabs(bottom));
    v.near_reach_m = options.near_t * (projection == Projection::kPinhole ? std::sqrt(1.0 + across * across + along * along) : 1.0);
    for (int i = 0; i < 3; ++i) {
        const double x = v.axis[0][i], y = v.axis[1][i], z = v.axis[2][i];
        const bool pinhole = projection == Projection::kPinhole;
        v.side[0][i] = x - (pinhole ? left * z : 0.0);
        v.side[1][i] = (pinhole ? right * z : 0.0) - x;
        v.side[2][i] = y - (pinhole ? top * z : 0.0);
        v.side[3][i] = (pinhole ? bottom * z : 0.0) - y;
    }
    if (projection == Projection::kParallel) {
        v.side_offset[0] = -left, v.side_offset[1] = right, v.side_offset[2] = -top, v.side_offset[3] = bottom;
    }
    for (int i = 0; i < 3; ++i) v.cone[i] = cone_C[0] * v.axis[0][i] + cone_C[1] * v.axis[1][i] + cone_C[2] * v.axis[2][i];
    v.cone[3] = cone_C[3];
    return v;
}

View View::in(const double *p_AG, const double *R_AG) const {
    View v = *this;
    const double d[3] = {p[0] - p_AG[0], p[1] - p_AG[1], p[2] - p_AG[2]};
    transposed_times(R_AG, d, v.p);
    for (int k = 0; k < 3; ++k) transposed_times(R_AG, axis[k], v.axis[k]);
    for (int k = 0; k < 4; ++k) transposed_times(R_AG, side[k], v.side[k]);
    transposed_times(R_AG, cone, v.cone);
    return v;
}

bool View::outside(const double *centre, const double *half) const {
    const double c[3] = {centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]};
    if (projection == Projection::kTable) {
        const double distance = std::sqrt(dot(c, c)), radius = 1.0001 * std::sqrt(dot(half, half)) + 1e-5;
        if (distance - radius > far_t) return true;
        if (cone[3] < -1.0 || distance <= radius) return false;
        const double sine = radius / distance, cosine = std::sqrt(1.0 - sine * sine);
        if (cone[3] + cosine <= 0.0) return false;
        const double cone_sine = std::sqrt(std::max(0.0, 1.0 - cone[3] * cone[3]));
        return dot(c, cone) / distance < cone[3] * cosine - cone_sine * sine - 1e-3;
    }
    const double z = dot(axis[2], c), hz = reach(axis[2], half);
    if (z + hz < near_t || z - hz > far_t) return true;
    // A quarter of a pixel on every side, and 1e-6 for rounding.
    const double margin = projection == Projection::kParallel ? 0.25 / fx + 1e-6 : 0.25 * (std::fabs(z) + hz) / fx + 1e-6;
    for (int k = 0; k < 4; ++k) {
        if (dot(side[k], c) + side_offset[k] + reach(side[k], half) + margin < 0.0) return true;
    }
    return false;
}

bool View::outside_on_its_way(const double *centre, const double *half, const double *way, double pad) const {
    const double c[3] = {centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]};
    for (const double *inward : {axis[2], side[0], side[1], side[2], side[3]}) {
        const double begin = dot(inward, c) + reach(inward, half) + pad * std::sqrt(dot(inward, inward));
        if (begin < 0.0 && begin + dot(inward, way) < 0.0) return true;
    }
    return false;
}

double View::nearest(const double *centre, const double *half) const {
    const double c[3] = {centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]};
    // Rounding of the vertices that the float kernels bring into C: 2^-24 of each coordinate for each of some operations.
    const double rounding = 1e-6 * (sum_of_sizes(c) + sum_of_sizes(half)) + 2e-7 * sum_of_sizes(p);
    if (projection == Projection::kTable) {
        double outside[3];  // to the box itself, not to a sphere around it: smaller boxes within it are not nearer
        for (int i = 0; i < 3; ++i) outside[i] = std::max(std::fabs(c[i]) - half[i], 0.0);
        return with_margin(std::sqrt(dot(outside, outside))) - rounding;
    }
    return with_margin(dot(axis[2], c) - reach(axis[2], half)) - rounding;
}

bool View::pixels(const double *centre, const double *half, PixelRect &rect) const {
    if (projection == Projection::kTable) return false;
    const double c[3] = {centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]};
    const double x = dot(axis[0], c), y = dot(axis[1], c), z = dot(axis[2], c);
    Range rx = kNothing, ry = kNothing;
    if (projection == Projection::kParallel) {
        const double hx = reach(axis[0], half), hy = reach(axis[1], half);
        rect = {cx + fx * (x - hx), cx + fx * (x + hx), cy + fy * (y - hy), cy + fy * (y + hy)};
        return true;
    }
    double arm[3][3];  // half edges in C
    for (int edge = 0; edge < 3; ++edge) {
        for (int k = 0; k < 3; ++k) arm[edge][k] = axis[k][edge] * half[edge];
    }
    double corner[8][3];
    for (int i = 0; i < 8; ++i) {
        const double a = i & 1 ? 1 : -1, b = i & 2 ? 1 : -1, e = i & 4 ? 1 : -1;
        corner[i][0] = x + a * arm[0][0] + b * arm[1][0] + e * arm[2][0];
        corner[i][1] = y + a * arm[0][1] + b * arm[1][1] + e * arm[2][1];
        corner[i][2] = z + a * arm[0][2] + b * arm[1][2] + e * arm[2][2];
    }
    if (z - reach(axis[2], half) > 1e-3) {
        for (const auto &p0 : corner) {
            const double inverse = 1.0 / p0[2];
            rx.take(p0[0] * inverse);
            ry.take(p0[1] * inverse);
        }
        rect = {cx + fx * rx.lo, cx + fx * rx.hi, cy + fy * ry.lo, cy + fy * ry.hi};
        return true;
    }
    // A box that extends behind the camera is clipped at half the near limit.
    const double z_near = 0.5 * near_t;
    for (int i = 0; i < 8; ++i) {
        const double *p0 = corner[i];
        if (p0[2] > z_near) {
            rx.take(p0[0] / p0[2]);
            ry.take(p0[1] / p0[2]);
        }
        for (int bit = 1; bit < 8; bit <<= 1) {
            const double *p1 = corner[i | bit];
            if ((i & bit) != 0 || (p0[2] > z_near) == (p1[2] > z_near)) continue;
            const double s = (z_near - p0[2]) / (p1[2] - p0[2]);
            rx.take((p0[0] + s * (p1[0] - p0[0])) / z_near);
            ry.take((p0[1] + s * (p1[1] - p0[1])) / z_near);
        }
    }
    rect = {cx + fx * rx.lo, cx + fx * rx.hi, cy + fy * ry.lo, cy + fy * ry.hi};
    return true;
}

void View::spans(const double *centre, const double *half, double first, double step, double reach, int count, Columns *lines) const {
    const double z_near = 0.5 * near_t;
    double corner[8][3];
    for (int i = 0; i < 8; ++i) {
        double d[3];
        for (int k = 0; k < 3; ++k) d[k] = centre[k] + (i >> k & 1 ? half[k] : -half[k]) - p[k];
        for (int k = 0; k < 3; ++k) corner[i][k] = dot(axis[k], d);
    }
    struct Point {
        double u, v;
    };
    const auto image = [&](double x, double y, double z) { return Point{cx + fx * (x / z), cy + fy * (y / z)}; };
    const auto segment = [&](Point a, Point b) {
        if (a.v > b.v) std::swap(a, b);
        const double slope = b.v - a.v > 1e-9 ? (b.u - a.u) / (b.v - a.v) : 0.0;
        const int from = static_cast<int>(std::clamp(std::ceil((a.v - reach - first) / step), 0.0, static_cast<double>(count)));
        const int to = static_cast<int>(std::clamp(std::floor((b.v + reach - first) / step), -1.0, count - 1.0));
        for (int i = from; i <= to; ++i) {
            const double v = first + step * i, top = std::max(v - reach, a.v), bottom = std::min(v + reach, b.v);
            const double u0 = a.u + (top - a.v) * slope, u1 = slope == 0.0 ? b.u : a.u + (bottom - a.v) * slope;
            lines[i].lo = std::min({lines[i].lo, u0, u1});
            lines[i].hi = std::max({lines[i].hi, u0, u1});
        }
    };
    // The image is convex. Its outline consists of images of edges, and of sides of the cut at half the near limit.
    Point cut[12];
    int cuts = 0;
    for (int i = 0; i < 8; ++i) {
        for (int bit = 1; bit < 8; bit <<= 1) {
            if (i & bit) continue;
            const double *a = corner[i], *b = corner[i | bit];
            if (a[2] <= z_near && b[2] <= z_near) continue;
            if (a[2] > z_near && b[2] > z_near) {
                segment(image(a[0], a[1], a[2]), image(b[0], b[1], b[2]));
                continue;
            }
            const double s = (z_near - a[2]) / (b[2] - a[2]);
            const Point at = image(a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), z_near);
            const double *front = a[2] > z_near ? a : b;
            segment(image(front[0], front[1], front[2]), at);
            for (int k = 0; k < cuts; ++k) segment(cut[k], at);
            cut[cuts++] = at;
        }
    }
}

void View::cone_of(const double *centre, const double *half, float *to) const {
    const double c[3] = {centre[0] - p[0], centre[1] - p[1], centre[2] - p[2]};
    const double distance = std::sqrt(dot(c, c)), radius = 1.0001 * std::sqrt(dot(half, half)) + 1e-5;
    to[0] = to[1] = to[2] = 0.0f;
    to[3] = -2.0f;
    if (!(distance > radius)) return;
    for (int k = 0; k < 3; ++k) to[k] = static_cast<float>(dot(axis[k], c) / distance);
    const double sine = radius / distance;
    to[3] = static_cast<float>(std::sqrt(1.0 - sine * sine));
}

bool pixels_of_geom(const View &view, const View &local, const Geom &g, PixelRect &rect, double &nearest) {
    const bool round = g.shape == Shape::kSphere || g.shape == Shape::kEllipsoid || g.shape == Shape::kCapsule ||
                       g.shape == Shape::kCylinder;
    if (!round || view.projection != Projection::kPinhole) {
        nearest = local.nearest(g.centre, g.half);
        return local.pixels(g.centre, g.half, rect);
    }
    double c[3], a[3][3];  // centre and axes in C: a[k] is the geom's axis k
    const double d[3] = {g.p_WG[0] - view.p[0], g.p_WG[1] - view.p[1], g.p_WG[2] - view.p[2]};
    for (int i = 0; i < 3; ++i) {
        c[i] = dot(view.axis[i], d);
        for (int k = 0; k < 3; ++k) {
            a[k][i] = view.axis[i][0] * g.R_WG[k] + view.axis[i][1] * g.R_WG[3 + k] + view.axis[i][2] * g.R_WG[6 + k];
        }
    }
    Range x = kNothing, y = kNothing;
    bool front;
    if (g.shape == Shape::kSphere || g.shape == Shape::kEllipsoid) {
        double A[6] = {};  // 11 13 22 23 33
        for (int k = 0; k < 3; ++k) {
            const double s = g.half[k], s2 = s * s;
            A[0] += s2 * a[k][0] * a[k][0];
            A[1] += s2 * a[k][0] * a[k][2];
            A[2] += s2 * a[k][1] * a[k][1];
            A[3] += s2 * a[k][1] * a[k][2];
            A[4] += s2 * a[k][2] * a[k][2];
        }
        nearest = with_margin(c[2] - std::sqrt(A[4]));
        front = nearest > 1e-3 && quadric_bounds(c, A[0], A[1], A[2], A[3], A[4], x, y);
    } else {
        // The hull of two spheres, or of two discs.
        const bool disc = g.shape == Shape::kCylinder;
        const double r2 = g.size[0] * g.size[0], *axis = a[2];
        const double off = disc ? r2 : 0.0;
        const double A11 = r2 - off * axis[0] * axis[0], A13 = -off * axis[0] * axis[2], A22 = r2 - off * axis[1] * axis[1];
        const double A23 = -off * axis[1] * axis[2], A33 = r2 - off * axis[2] * axis[2];
        nearest = with_margin(c[2] - std::fabs(axis[2]) * g.size[1] - std::sqrt(std::max(0.0, A33)));
        front = nearest > 1e-3;
        for (int end = -1; end <= 1 && front; end += 2) {
            const double e[3] = {c[0] + end * g.size[1] * axis[0], c[1] + end * g.size[1] * axis[1],
                                 c[2] + end * g.size[1] * axis[2]};
            front = quadric_bounds(e, A11, A13, A22, A23, A33, x, y);
        }
    }
    rect = {view.cx + view.fx * x.lo, view.cx + view.fx * x.hi, view.cy + view.fy * y.lo, view.cy + view.fy * y.hi};
    return front;
}

}  // namespace hil::sim::frame
