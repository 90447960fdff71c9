// 3-vectors, quaternions (w-x-y-z) and rotation matrices for the vehicle, its sensors, estimator and controller.
//
// q_WB rotates vectors of B into W: v_W = rotate(q_WB, v_B). Heading, roll, pitch and yaw are those of an FRD body in
// NED.
// Pure functions that use + - * / sqrt and detmath only: same bits on every machine.
#pragma once

#include <cmath>

#include "detmath.hpp"

namespace hil {

struct Vec3 {
    double x = 0.0, y = 0.0, z = 0.0;
};

inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double dot(const double *a, const double *b) { return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]; }
inline void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}
inline double norm(Vec3 a) { return std::sqrt(dot(a, a)); }
inline bool is_finite(Vec3 a) { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }
inline double clamp(double x, double lo, double hi) { return x < lo ? lo : (x > hi ? hi : x); }

struct Quat {
    double w = 1.0, x = 0.0, y = 0.0, z = 0.0;
};

inline Quat operator*(Quat a, Quat b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}
inline Quat conjugate(Quat q) { return {q.w, -q.x, -q.y, -q.z}; }
inline Quat normalized(Quat q) {
    const double n = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    return {q.w / n, q.x / n, q.y / n, q.z / n};
}

// R(q) v = v + 2 w (u x v) + 2 u x (u x v), u = vector part.
inline Vec3 rotate(Quat q, Vec3 v) {
    const Vec3 u{q.x, q.y, q.z};
    const Vec3 t = 2.0 * cross(u, v);
    return v + q.w * t + cross(u, t);
}

// R(q / |q|), row by row. Integrator stages leave the unit sphere by O(h^2); dividing by |q|^2 keeps R a rotation.
inline void rotation_matrix(const double *q, double R[9]) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double s = 2.0 / ((w * w + x * x) + (y * y + z * z));
    R[0] = 1.0 - s * (y * y + z * z);
    R[1] = s * (x * y - w * z);
    R[2] = s * (x * z + w * y);
    R[3] = s * (x * y + w * z);
    R[4] = 1.0 - s * (x * x + z * z);
    R[5] = s * (y * z - w * x);
    R[6] = s * (x * z - w * y);
    R[7] = s * (y * z + w * x);
    R[8] = 1.0 - s * (x * x + y * y);
}

// v_B = R(q)^T v_W and v_W = R(q) v_B by the matrix.
inline void rotate_into_body(const double *q_WB, const double *v_W, double *v_B) {
    double R[9];
    rotation_matrix(q_WB, R);
    for (int j = 0; j < 3; ++j) v_B[j] = R[j] * v_W[0] + R[3 + j] * v_W[1] + R[6 + j] * v_W[2];
}
inline void rotate_into_world(const double *q_WB, const double *v_B, double *v_W) {
    double R[9];
    rotation_matrix(q_WB, R);
    for (int j = 0; j < 3; ++j) v_W[j] = R[3 * j] * v_B[0] + R[3 * j + 1] * v_B[1] + R[3 * j + 2] * v_B[2];
}

// Heading of the body x axis, rad in (-pi, pi], clockwise from north.
inline double yaw_of(Quat q) {
    return det::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
}

// Roll, pitch, yaw, rad (yaw first, then pitch, then roll: aerospace order).
inline Vec3 euler_of(Quat q) {
    const double sin_pitch = clamp(2.0 * (q.w * q.y - q.z * q.x), -1.0, 1.0);
    return {det::atan2(2.0 * (q.w * q.x + q.y * q.z), 1.0 - 2.0 * (q.x * q.x + q.y * q.y)), det::asin(sin_pitch),
            yaw_of(q)};
}

inline Quat from_euler(double roll, double pitch, double yaw) {
    const double cr = det::cos(0.5 * roll), sr = det::sin(0.5 * roll);
    const double cp = det::cos(0.5 * pitch), sp = det::sin(0.5 * pitch);
    const double cy = det::cos(0.5 * yaw), sy = det::sin(0.5 * yaw);
    return {cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy};
}

// Quaternion of the rotation matrix with orthonormal columns (bx, by, bz), after Shepperd (1978): the largest
// component is computed first and divides the others.
inline Quat from_axes(Vec3 bx, Vec3 by, Vec3 bz) {
    const double trace = bx.x + by.y + bz.z;
    Quat q;
    if (trace > 0.0) {
        const double s = std::sqrt(trace + 1.0);
        q = {0.5 * s, 0.5 * (by.z - bz.y) / s, 0.5 * (bz.x - bx.z) / s, 0.5 * (bx.y - by.x) / s};
    } else if (bx.x >= by.y && bx.x >= bz.z) {
        const double s = std::sqrt(1.0 + bx.x - by.y - bz.z);
        q = {0.5 * (by.z - bz.y) / s, 0.5 * s, 0.5 * (by.x + bx.y) / s, 0.5 * (bz.x + bx.z) / s};
    } else if (by.y >= bz.z) {
        const double s = std::sqrt(1.0 + by.y - bx.x - bz.z);
        q = {0.5 * (bz.x - bx.z) / s, 0.5 * (by.x + bx.y) / s, 0.5 * s, 0.5 * (bz.y + by.z) / s};
    } else {
        const double s = std::sqrt(1.0 + bz.z - bx.x - by.y);
        q = {0.5 * (bx.y - by.x) / s, 0.5 * (bz.x + bx.z) / s, 0.5 * (bz.y + by.z) / s, 0.5 * s};
    }
    return normalized(q);
}

// Angle folded into [-pi, pi).
inline double wrap_pi(double a) {
    constexpr double kTwoPi = 2.0 * det::kPi;
    return a - kTwoPi * std::floor((a + det::kPi) / kTwoPi);
}

}  // namespace hil
