#include "gnss_fix.hpp"

#include <cmath>

namespace hil::sim {

namespace {

constexpr double kHeld = 1.0e4;         // weight of a height that is held, over that of a satellite at the zenith
constexpr double kSingular = 1.0e-10;   // smallest pivot of Cholesky's method over the greatest diagonal

// Inverts the symmetric, positive definite `n` (lower triangle) into `q`. Returns false if it is singular.
bool inverse(const double (&n)[4][4], double (&q)[4][4]) {
    double l[4][4] = {}, greatest = 0.0;
    for (int i = 0; i < 4; ++i) greatest = n[i][i] > greatest ? n[i][i] : greatest;
    for (int j = 0; j < 4; ++j) {
        double pivot = n[j][j];
        for (int k = 0; k < j; ++k) pivot -= l[j][k] * l[j][k];
        if (!(pivot > kSingular * greatest)) return false;
        l[j][j] = std::sqrt(pivot);
        for (int i = j + 1; i < 4; ++i) {
            double sum = n[i][j];
            for (int k = 0; k < j; ++k) sum -= l[i][k] * l[j][k];
            l[i][j] = sum / l[j][j];
        }
    }
    for (int c = 0; c < 4; ++c) {
        double y[4];
        for (int i = 0; i < 4; ++i) {
            y[i] = i == c ? 1.0 : 0.0;
            for (int k = 0; k < i; ++k) y[i] -= l[i][k] * y[k];
            y[i] /= l[i][i];
        }
        for (int i = 3; i >= 0; --i) {
            for (int k = i + 1; k < 4; ++k) y[i] -= l[k][i] * q[k][c];
            q[i][c] = y[i] / l[i][i];
        }
    }
    return true;
}

void add_row(double (&n)[4][4], const double (&row)[4], double weight) {
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j <= i; ++j) n[i][j] += weight * row[i] * row[j];
    }
}

}  // namespace

GnssFix solve_gnss(const double *directions, const double *weights, const double *errors, std::size_t count, bool held,
                   double height_error, double *residuals) {
    GnssFix fix;
    if (count + (held ? 1 : 0) < 4) return fix;
    double weighted[4][4] = {}, plain[4][4] = {}, right[4] = {}, q[4][4], p[4][4];
    for (std::size_t s = 0; s < count; ++s) {
        const double row[4] = {-directions[3 * s], -directions[3 * s + 1], -directions[3 * s + 2], 1.0};
        add_row(weighted, row, weights[s]);
        add_row(plain, row, 1.0);
        for (int i = 0; i < 4; ++i) right[i] += row[i] * weights[s] * errors[s];
    }
    if (held) {
        const double row[4] = {0.0, 0.0, 1.0, 0.0};
        add_row(weighted, row, kHeld);
        add_row(plain, row, kHeld);
        right[2] += kHeld * height_error;
    }
    if (!inverse(weighted, q) || !inverse(plain, p)) return fix;
    fix.solved = true;
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) fix.shift[i] += q[i][j] * right[j];
        fix.variance[i] = q[i][i];
        fix.dilution[i] = p[i][i];
    }
    for (std::size_t s = 0; s < count; ++s) {
        double seen = fix.shift[3];
        for (int i = 0; i < 3; ++i) seen -= directions[3 * s + i] * fix.shift[i];
        residuals[s] = errors[s] - seen;
    }
    return fix;
}

}  // namespace hil::sim
