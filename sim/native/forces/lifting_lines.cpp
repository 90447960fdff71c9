#include "lifting_lines.hpp"

#include <cmath>
#include <cstddef>
#include <stdexcept>

#include "detmath.hpp"
#include "rotation.hpp"

namespace hil::sim {

namespace {

constexpr double kLeastPivot = 1e-12;
constexpr double kOnLine = 1e-16;  // (sine of the angle to a vortex)^2 of a point that is on its line

// Adds 4 pi times the velocity at `p` of a vortex of circulation 1 from `a` to `b`.
void add_segment(const double *a, const double *b, const double *p, double core2, double *out) {
    double ra[3], rb[3], along[3], turn[3];
    for (int j = 0; j < 3; ++j) {
        ra[j] = p[j] - a[j];
        rb[j] = p[j] - b[j];
        along[j] = b[j] - a[j];
    }
    cross(ra, rb, turn);
    const double size2 = dot(turn, turn) + core2 * dot(along, along);
    if (!(size2 > kOnLine * (dot(ra, ra) * dot(along, along)))) return;
    const double from = dot(along, ra) / std::sqrt(dot(ra, ra) + core2), to = dot(along, rb) / std::sqrt(dot(rb, rb) + core2);
    for (int j = 0; j < 3; ++j) out[j] += turn[j] * ((from - to) / size2);
}

// The same for a vortex from `a` along -x to infinity, times `sign`.
void add_trail(const double *a, double sign, const double *p, double core2, double *out) {
    const double r[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    const double across2 = (r[1] * r[1] + r[2] * r[2]) + core2;
    if (!(across2 > 0.0)) return;
    const double share = (1.0 - r[0] / std::sqrt(dot(r, r) + core2)) / across2;
    out[1] += sign * (r[2] * share);
    out[2] -= sign * (r[1] * share);
}

// Velocity at `p`, a point of panel `at`, of vortex `of` with a circulation of 1, against the normal of the panel.
double coefficient(const LiftingLine &at, const double *p, const LiftingLine &of, bool bound) {
    double width[3];
    for (int j = 0; j < 3; ++j) width[j] = of.left_m[j] - of.right_m[j];
    const double behind = 0.5 * (of.left_m[0] + of.right_m[0]) - p[0], width2 = dot(width, width), behind2 = behind * behind;
    double core2 = 0.0;
    if (at.sheet != of.sheet && behind > 0.0) core2 = 0.25 * width2 * behind2 / (behind2 + 4.0 * width2);
    double v[3] = {0.0, 0.0, 0.0};
    add_trail(of.left_m, -1.0, p, core2, v);
    if (bound) add_segment(of.left_m, of.right_m, p, core2, v);
    add_trail(of.right_m, 1.0, p, core2, v);
    return -dot(v, at.normal) / (4.0 * det::kPi);
}

// Inverts `a` [n][n] into `inverse`.
void invert(std::vector<double> &a, std::vector<double> &inverse, std::size_t n) {
    inverse.assign(n * n, 0.0);
    for (std::size_t i = 0; i < n; ++i) inverse[i * n + i] = 1.0;
    for (std::size_t col = 0; col < n; ++col) {
        std::size_t best = col;
        for (std::size_t row = col + 1; row < n; ++row) {
            if (std::fabs(a[row * n + col]) > std::fabs(a[best * n + col])) best = row;
        }
        if (!(std::fabs(a[best * n + col]) > kLeastPivot)) {
            throw std::invalid_argument("panels of the wings coincide: their vortices have no solution");
        }
        for (std::size_t k = 0; k < n && best != col; ++k) {
            const double kept = a[col * n + k], turned = inverse[col * n + k];
            a[col * n + k] = a[best * n + k];
            a[best * n + k] = kept;
            inverse[col * n + k] = inverse[best * n + k];
            inverse[best * n + k] = turned;
        }
        const double pivot = 1.0 / a[col * n + col];
        for (std::size_t k = 0; k < n; ++k) {
            a[col * n + k] *= pivot;
            inverse[col * n + k] *= pivot;
        }
        for (std::size_t row = 0; row < n; ++row) {
            if (row == col) continue;
            const double factor = a[row * n + col];
            for (std::size_t k = 0; k < n; ++k) {
                a[row * n + k] -= factor * a[col * n + k];
                inverse[row * n + k] -= factor * inverse[col * n + k];
            }
        }
    }
}

}  // namespace

void influence(const std::vector<LiftingLine> &panels, std::vector<double> &seen, std::vector<double> &tilting) {
    const std::size_t n = panels.size();
    std::vector<double> a(n * n), b(n * n), half(n);
    for (std::size_t i = 0; i < n; ++i) {
        const LiftingLine &at = panels[i];
        for (std::size_t j = 0; j < n; ++j) {
            a[i * n + j] = coefficient(at, at.seen_m, panels[j], true);
            b[i * n + j] = coefficient(at, at.quarter_m, panels[j], i != j);
        }
        half[i] = 0.5 * at.slope_per_rad * at.chord_m;
        a[i * n + i] += 1.0 / half[i] - 1.0 / (det::kPi * at.chord_m);
    }
    std::vector<double> circulation;
    invert(a, circulation, n);
    seen.assign(n * n, 0.0);
    tilting.assign(n * n, 0.0);
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < n; ++j) {
            seen[i * n + j] = (i == j ? 1.0 : 0.0) - circulation[i * n + j] / half[i];
            double sum = 0.0;
            for (std::size_t k = 0; k < n; ++k) sum += b[i * n + k] * circulation[k * n + j];
            tilting[i * n + j] = sum;
        }
    }
}

}  // namespace hil::sim
