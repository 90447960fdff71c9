// Inner loop of the scatterers, 16 pixels at a time. Contract: scatterers.hpp.
#include "scatterers.hpp"

#include "../frame/lane_memory.hpp"

namespace hil::sim::radar::HIL_ISA {

namespace {

using namespace frame::HIL_ISA;

constexpr float kMostCosine = 1.001f;  // limit of |cosine| for unit vectors in float; beyond it the normal is invalid

HIL_INLINE int count(unsigned set) { return __builtin_popcount(set); }

HIL_INLINE I widened(const std::uint8_t *from) {
    std::int32_t wide[kLanes];
    for (int i = 0; i < kLanes; ++i) wide[i] = from[i];
    return load<I>(wide);
}

HIL_INLINE D widened(const float *from) {
    typedef float Half __attribute__((vector_size(kRegisterBytes / 2)));
    D v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        Half h;
        __builtin_memcpy(&h, from + i * (kRegisterBytes / 8), sizeof h);
        v.r[i] = __builtin_convertvector(h, DoubleRegister);
    }
    return v;
}

// The lanes of `from` that are not in `out`.
HIL_INLINE I without(const I &from, const I &out) { return from & ~out; }

// Converts pixels [first, first + 16) of the plan; `picture` points to pixel `first`. Returns the number of echoes.
HIL_INLINE long collect_block(const PixelPlan &plan, const PixelPicture &picture, const EchoColumns &out, long first,
                              long at, ScatterCounts &counts) {
    const float *block = plan.blocks + 4 * first;
    const F weight = load<F>(block + 48);
    const I active = weight > splat<F>(0.0f);
    if (!any(active)) return 0;
    const F range = load<F>(picture.range_m), infinite = splat<F>(__builtin_inff());
    const I good = active & (range > splat<F>(0.0f));  // false for NaN
    counts.invalid += count(bits(without(active, good)));
    I left = good & (range < infinite);
    counts.sky += count(bits(without(good, left)));
    if (!any(left)) return 0;

    const I material = widened(picture.material);
    I drop = left & (material == splat<I>(0));
    counts.nothing += count(bits(drop));
    left = without(left, drop);
    drop = left & (material >= splat<I>(plan.surfaces));
    counts.unknown += count(bits(drop));
    left = without(left, drop);
    drop = left & (range > splat<F>(plan.max_range_m));
    counts.range += count(bits(drop));
    left = without(left, drop);
    if (plan.class_kept != nullptr) {
        std::int32_t kept[kLanes];
        for (int i = 0; i < kLanes; ++i) kept[i] = plan.class_kept[picture.segmentation[i]];
        drop = left & (load<I>(kept) == splat<I>(0));
        counts.classes += count(bits(drop));
        left = without(left, drop);
    }
    if (!any(left)) return 0;

    float x[kLanes], y[kLanes], z[kLanes];
    for (int i = 0; i < kLanes; ++i) {
        x[i] = picture.normal_C[3 * i];
        y[i] = picture.normal_C[3 * i + 1];
        z[i] = picture.normal_C[3 * i + 2];
    }
    const F cosine = -(load<F>(x) * load<F>(block) + load<F>(y) * load<F>(block + 16) + load<F>(z) * load<F>(block + 32));
    const F speed = load<F>(picture.radial_velocity_mps);
    const I sane = left & (abs(cosine) <= splat<F>(kMostCosine)) & (abs(speed) < infinite);
    counts.invalid += count(bits(without(left, sane)));
    left = sane & (cosine > splat<F>(0.0f));
    counts.away += count(bits(without(sane, left)));

    const F one = splat<F>(1.0f), none = splat<F>(0.0f);
    const F place = sqrt(min(select(left, cosine, none), one)) * splat<F>((float)kCurveSteps);
    const I step = truncate(place), last = splat<I>(kCurveSteps - 1);
    const I node = select(step < last, step, last);
    const F share = place - to_float(node);
    const I row = select(left, material, splat<I>(0));
    std::int32_t rows[kLanes];
    store(rows, row);
    for (int i = 0; i < kLanes; ++i) rows[i] *= kCurveSteps + 1;
    const I index = load<I>(rows) + node;
    const F low = gather(plan.curves, index), high = gather(plan.curves + 1, index);
    const F strength = weight * (low + share * (high - low));
    const I sends = left & (strength > none);
    counts.nothing += count(bits(without(left, sends)));

    float strengths[kLanes];
    store(strengths, strength);
    unsigned set = bits(sends);
    if (set == (1u << kLanes) - 1) {  // the usual case: the same for all lanes at once
        for (int i = 0; i < kLanes; i += D::kCount) {
            const D range_m = widened(picture.range_m + i);
            store(out.range_m + at + i, range_m);
            store(out.speed_mps + at + i, widened(picture.radial_velocity_mps + i));
            store(out.amplitude + at + i, widened(strengths + i) / range_m);
        }
        __builtin_memcpy(out.direction_R + 3 * at, plan.direction_R + 3 * first, 3 * kLanes * sizeof(double));
        counts.kept += kLanes;
        return kLanes;
    }
    const long start = at;
    while (set != 0) {
        const int i = __builtin_ctz(set);
        set &= set - 1;
        const double range_m = (double)picture.range_m[i];
        out.range_m[at] = range_m;
        out.speed_mps[at] = (double)picture.radial_velocity_mps[i];
        const double *direction = plan.direction_R + 3 * (first + i);
        out.direction_R[3 * at] = direction[0];
        out.direction_R[3 * at + 1] = direction[1];
        out.direction_R[3 * at + 2] = direction[2];
        out.amplitude[at] = (double)strengths[i] / range_m;
        ++at;
    }
    counts.kept += at - start;
    return at - start;
}

void collect(const PixelPlan &plan, const PixelPicture &picture, const EchoColumns &out, ScatterCounts &counts) {
    long at = 0, first = 0;
    for (; first + kLanes <= plan.pixels; first += kLanes) {
        const PixelPicture here = {picture.range_m + first, picture.normal_C + 3 * first,
                                   picture.radial_velocity_mps + first, picture.material + first,
                                   picture.segmentation != nullptr ? picture.segmentation + first : nullptr};
        at += collect_block(plan, here, out, first, at, counts);
    }
    const int rest = (int)(plan.pixels - first);
    if (rest == 0) return;
    // Copy the last, incomplete block and pad it with pixels of weight 0.
    float range[kLanes] = {}, normal[3 * kLanes] = {}, speed[kLanes] = {};
    std::uint8_t material[kLanes] = {}, segmentation[kLanes] = {};
    for (int i = 0; i < rest; ++i) {
        range[i] = picture.range_m[first + i];
        speed[i] = picture.radial_velocity_mps[first + i];
        material[i] = picture.material[first + i];
        if (picture.segmentation != nullptr) segmentation[i] = picture.segmentation[first + i];
        for (int k = 0; k < 3; ++k) normal[3 * i + k] = picture.normal_C[3 * (first + i) + k];
    }
    collect_block(plan, {range, normal, speed, material, segmentation}, out, first, at, counts);
}

}  // namespace

extern const ScatterKernels scatter_kernels_of_isa;
const ScatterKernels scatter_kernels_of_isa = {collect};

}  // namespace hil::sim::radar::HIL_ISA
