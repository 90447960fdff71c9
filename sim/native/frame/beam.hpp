// Bounds of many rays (a beam), and the traversal of a tree with a beam. For use in *.isa.cpp only.
#pragma once

#include "lane_memory.hpp"
#include "ray_cast.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

constexpr double kInf = __builtin_inf();
constexpr double kSameWay = 1e-9;    // direction components below this may have either sign

// Bounds of rays per axis, stored so that the test of a node has no branches.
//
// If all rays have the same sign along an axis, `near` and `away` are the rows of a node (low or high faces) that a ray
// passes first and last. Each comes with the bound of the origins that makes the interval widest; the inverse directions
// are in [i_lo, i_hi]. If signs differ, the inverses are zero and `open` is infinite: the faces constrain nothing.
struct Beam {
    double o_near[3], o_away[3], i_lo[3], i_hi[3], open[3];
    int near[3], away[3];
    double o_lo[3], o_hi[3], d_lo[3], d_hi[3];
    unsigned both_ways;  // bit per axis: rays of both signs
    double t_min;
};

HIL_INLINE double smaller(double a, double b) { return a < b ? a : b; }
HIL_INLINE double larger(double a, double b) { return a > b ? a : b; }

// Largest and smallest lane; no lane may be NaN.
HIL_INLINE double largest(const D &a) {
#if defined(__AVX512F__)
    return _mm512_reduce_max_pd((__m512d)a.r[0]);
#else
    DoubleRegister m = a.r[0];
    for (int i = 1; i < kParts; ++i) m = m > a.r[i] ? m : a.r[i];
    double found = m[0];
    for (int k = 1; k < kRegisterBytes / 8; ++k) found = larger(found, m[k]);
    return found;
#endif
}
HIL_INLINE double smallest(const D &a) {
#if defined(__AVX512F__)
    return _mm512_reduce_min_pd((__m512d)a.r[0]);
#else
    DoubleRegister m = a.r[0];
    for (int i = 1; i < kParts; ++i) m = m < a.r[i] ? m : a.r[i];
    double found = m[0];
    for (int k = 1; k < kRegisterBytes / 8; ++k) found = smaller(found, m[k]);
    return found;
#endif
}

// Load eight floats as doubles.
HIL_INLINE D load_floats(const float *p) {
    D v;
#if defined(__AVX512F__)
    v.r[0] = (DoubleRegister)_mm512_maskz_cvtps_pd(0xff, _mm256_loadu_ps(p));
#else
    typedef float Half __attribute__((vector_size(kRegisterBytes / 2)));
    for (int i = 0; i < kParts; ++i) {
        Half half;
        __builtin_memcpy(&half, p + (kRegisterBytes / 8) * i, sizeof half);
        v.r[i] = __builtin_convertvector(half, DoubleRegister);
    }
#endif
    return v;
}

// Bounds of numbers, lane by lane.
struct Span {
    D lo, hi;
};
HIL_INLINE Span only(const D &v) { return {v, v}; }
HIL_INLINE Span both(const Span &a, const D &b) { return {min(a.lo, b), max(a.hi, b)}; }

HIL_INLINE void bound(const Span &o, const Span &d, int axis, Beam &b) {
    const double o_lo = smallest(o.lo), o_hi = largest(o.hi), lo = smallest(d.lo), hi = largest(d.hi);
    const bool up = lo > kSameWay, down = hi < -kSameWay, one_way = up || down;
    b.o_lo[axis] = o_lo, b.o_hi[axis] = o_hi;
    b.d_lo[axis] = smaller(lo, 0.0), b.d_hi[axis] = larger(hi, 0.0);
    b.near[axis] = down ? 3 + axis : axis;
    b.away[axis] = down ? axis : 3 + axis;
    b.o_near[axis] = down ? o_lo : o_hi;
    b.o_away[axis] = down ? o_hi : o_lo;
    b.i_lo[axis] = one_way ? 1.0 / hi : 0.0;
    b.i_hi[axis] = one_way ? 1.0 / lo : 0.0;
    b.open[axis] = one_way ? 0.0 : kInf;
    b.both_ways |= one_way ? 0u : 1u << axis;
}

HIL_INLINE Beam beam_of(const Vec<D> &o, const Vec<D> &d, double t_min) {
    Beam b;
    b.both_ways = 0;
    bound(only(o.x), only(d.x), 0, b);
    bound(only(o.y), only(d.y), 1, b);
    bound(only(o.z), only(d.z), 2, b);
    b.t_min = t_min;
    return b;
}

// Return a bit for each of a node's eight boxes that a ray of the beam may meet before `far`; `entry` receives a lower
// bound of the t at which it does.
HIL_INLINE unsigned reached(const WideNode &node, const Beam &b, double far, D &entry) {
    D enter = splat<D>(b.t_min), leave = splat<D>(far);
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
        const D near = load_floats(node.face[b.near[a]]) - b.o_near[a];
        const D away = load_floats(node.face[b.away[a]]) - b.o_away[a];
        enter = max(enter, min(near * b.i_lo[a], near * b.i_hi[a]) - b.open[a]);
        leave = min(leave, max(away * b.i_lo[a], away * b.i_hi[a]) + b.open[a]);
    }
    unsigned met = bits(enter <= leave);
    // Axes with directions of both signs: compare the box with the region that the beam sweeps up to `leave`.
    if (b.both_ways != 0 && met != 0) {
        for (int a = 0; a < 3; ++a) {
            if ((b.both_ways >> a & 1u) == 0) continue;
            met &= bits(b.o_lo[a] + leave * b.d_lo[a] <= load_floats(node.face[3 + a]));
            met &= bits(b.o_hi[a] + leave * b.d_hi[a] >= load_floats(node.face[a]));
        }
    }
    entry = enter;
    return met;
}

// Visit the items that the beam reaches before `far`, near to far. `on_item` may reduce `far`.
template <class OnItem>
HIL_INLINE void walk(const WideNode *nodes, const Beam &beam, StackEntry *stack, const double &far, OnItem on_item) {
    int top = 0;
    stack[top++] = {beam.t_min, 0};
    while (top > 0) {
        const StackEntry next = stack[--top];
        if (next.near > far) continue;
        if (next.child < 0) {
            on_item(~next.child, next.near, stack + top);
            continue;
        }
        const WideNode &node = nodes[next.child];
        D entry;
        unsigned met = reached(node, beam, far, entry);
        double near[kLanes];
        store(near, entry);
        const int bottom = top;
        while (met != 0) {
            const int i = __builtin_ctz(met);
            met &= met - 1;
            int at = top++;
            for (; at > bottom && stack[at - 1].near < near[i]; --at) stack[at] = stack[at - 1];
            stack[at] = {near[i], node.child[i]};
        }
    }
}

}  // namespace
}  // namespace hil::sim::frame::HIL_ISA
