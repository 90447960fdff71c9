// Rays of a sweep, eight at once, each with its own pose. Contract: sweep_rays.hpp.
#include "sweep_rays.hpp"

#include "lane_memory.hpp"
#include "triples.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {


// (-1)^k / (2k)! and (-1)^k / (2k + 1)!, highest power first. Up to |x| = 1 the first omitted term is at most 1 / 20!.
constexpr double kCos[10] = {-1.0 / 6402373705728000.0, 1.0 / 20922789888000.0, -1.0 / 87178291200.0,
                             1.0 / 479001600.0,         -1.0 / 3628800.0,       1.0 / 40320.0,
                             -1.0 / 720.0,              1.0 / 24.0,             -1.0 / 2.0,
                             1.0};
constexpr double kSinc[10] = {-1.0 / 121645100408832000.0, 1.0 / 355687428096000.0, -1.0 / 1307674368000.0,
                              1.0 / 6227020800.0,          -1.0 / 39916800.0,       1.0 / 362880.0,
                              -1.0 / 5040.0,               1.0 / 120.0,             -1.0 / 6.0,
                              1.0};

// cos x and sin x / x from x^2: series up to |x| = 1, detmath beyond.
HIL_INLINE void cos_and_sinc(const D &x2, D &cosine, D &sinc) {
    cosine = splat<D>(kCos[0]), sinc = splat<D>(kSinc[0]);
#pragma GCC unroll 9
    for (int k = 1; k < 10; ++k) {
        cosine = cosine * x2 + kCos[k];
        sinc = sinc * x2 + kSinc[k];
    }
    unsigned beyond = bits(x2 > splat<D>(1.0));
    if (beyond == 0) return;
    double x[kLanes], c[kLanes], s[kLanes];
    store(x, x2), store(c, cosine), store(s, sinc);
    for (; beyond != 0; beyond &= beyond - 1) {
        const int i = __builtin_ctz(beyond);
        far_cos_and_sinc(x[i], c[i], s[i]);
    }
    cosine = load<D>(c), sinc = load<D>(s);
}

struct Poses {
    Vec<D> p, row[3];  // rows of R
};

HIL_INLINE D cubic(const D &s, double c1, double c2, double c3) { return s * (c1 + s * (c2 + s * c3)); }

HIL_INLINE Poses poses_at(const SweepMotion &m, const D &s) {
    const Vec<D> f{cubic(s, m.f1[0], m.f2[0], m.f3[0]), cubic(s, m.f1[1], m.f2[1], m.f3[1]),
                   cubic(s, m.f1[2], m.f2[2], m.f3[2])};
    D c, k;
    cos_and_sinc(0.25 * (f.x * f.x + f.y * f.y + f.z * f.z), c, k);
    const double q0 = m.q_WB[0], q1 = m.q_WB[1], q2 = m.q_WB[2], q3 = m.q_WB[3];
    const D x = 0.5 * k * f.x, y = 0.5 * k * f.y, z = 0.5 * k * f.z;
    const D a = q0 * c - q1 * x - q2 * y - q3 * z, b = q0 * x + q1 * c + q2 * z - q3 * y;
    const D d = q0 * y - q1 * z + q2 * c + q3 * x, e = q0 * z + q1 * y - q2 * x + q3 * c;
    Poses out;
    out.p = {m.p[0] + cubic(s, m.c1[0], m.c2[0], m.c3[0]), m.p[1] + cubic(s, m.c1[1], m.c2[1], m.c3[1]),
             m.p[2] + cubic(s, m.c1[2], m.c2[2], m.c3[2])};
    out.row[0] = {1.0 - 2.0 * (d * d + e * e), 2.0 * (b * d - a * e), 2.0 * (b * e + a * d)};
    out.row[1] = {2.0 * (b * d + a * e), 1.0 - 2.0 * (b * b + e * e), 2.0 * (d * e - a * b)};
    out.row[2] = {2.0 * (b * e - a * d), 2.0 * (d * e + a * b), 1.0 - 2.0 * (b * b + d * d)};
    return out;
}

// Loads eight integers; lanes beyond `count` repeat the last one.
HIL_INLINE D load_offsets(const std::int32_t *from, int count) {
    std::int32_t some[kLanes];
    if (count < kLanes) {
        for (int i = 0; i < kLanes; ++i) some[i] = from[i < count ? i : count - 1];
        from = some;
    }
    typedef std::int32_t Half __attribute__((vector_size(kRegisterBytes / 2)));
    D v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        Half half;
        __builtin_memcpy(&half, from + i * (kRegisterBytes / 8), sizeof half);
        v.r[i] = __builtin_convertvector(half, DoubleRegister);
    }
    return v;
}

HIL_INLINE void reduce(const D &low, const D &high, double &lo, double &hi) {
    double a[kLanes], b[kLanes];
    store(a, low), store(b, high);
    lo = a[0], hi = b[0];
    for (int i = 1; i < kLanes; ++i) lo = a[i] < lo ? a[i] : lo, hi = b[i] > hi ? b[i] : hi;
}

void sweep(const SweepMotion &motion, const std::int32_t *time_offset_ns, const double *origin_B,
           const double *direction_B, double *origin_W, double *direction_W, std::size_t count, SweepBox &box) {
    const D inf = splat<D>(__builtin_inf());
    Vec<D> low{inf, inf, inf}, high{-inf, -inf, -inf};
    for (std::size_t first = 0; first < count; first += kLanes) {
        const int n = count - first < (std::size_t)kLanes ? (int)(count - first) : kLanes;
        const Poses pose = poses_at(motion, 1e-9 * load_offsets(time_offset_ns + first, n));
        const Vec<D> o = load_rows(origin_B + 3 * first, n), d = load_rows(direction_B + 3 * first, n);
        const Vec<D> from{pose.p.x + dot(pose.row[0], o), pose.p.y + dot(pose.row[1], o),
                          pose.p.z + dot(pose.row[2], o)};
        low = {min(low.x, from.x), min(low.y, from.y), min(low.z, from.z)};
        high = {max(high.x, from.x), max(high.y, from.y), max(high.z, from.z)};
        store_rows(origin_W + 3 * first, from, n);
        store_rows(direction_W + 3 * first, {dot(pose.row[0], d), dot(pose.row[1], d), dot(pose.row[2], d)}, n);
    }
    reduce(low.x, high.x, box.lo[0], box.hi[0]);
    reduce(low.y, high.y, box.lo[1], box.hi[1]);
    reduce(low.z, high.z, box.lo[2], box.hi[2]);
}

}  // namespace

extern const SweepKernel sweep_rays_of_isa;
const SweepKernel sweep_rays_of_isa = sweep;

}  // namespace hil::sim::frame::HIL_ISA
