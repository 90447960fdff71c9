// Receiver of a LiDAR for eight rays at once. Contract: lidar_receiver.hpp.
#include "lidar_receiver.hpp"

#include "noise_stream.hpp"
#include "normal_centre.hpp"
#include "lane_memory.hpp"

namespace hil::sim::frame::HIL_ISA {
namespace {

constexpr double kInf = __builtin_inf();
constexpr double kSure = 0.9, kNever = 1.1;  // range / range limit: always seen below, never seen above
constexpr double kReference = 0.1;           // reflectivity for which the limit is given

// Largest integer not above x; x itself from |x| = 2^51 on.
HIL_INLINE D whole(const D &x) {
    const D shift = splat<D>(0x1.8p52), one = splat<D>(1.0);
    const D near = (x + shift) - shift;
    const D down = select(near > x, near - one, near);
    return select(abs(x) < splat<D>(0x1p51), down, x);
}

// from[place], lane by lane.
HIL_INLINE D picked(const double *from, const std::int32_t *place) {
    D v;
    HIL_UNROLL for (int i = 0; i < kParts; ++i) {
        const std::int32_t *p = place + i * (kRegisterBytes / 8);
#if defined(__AVX512F__)
        v.r[i] = (DoubleRegister){from[p[0]], from[p[1]], from[p[2]], from[p[3]],
                                  from[p[4]], from[p[5]], from[p[6]], from[p[7]]};
#elif defined(__AVX2__)
        v.r[i] = (DoubleRegister){from[p[0]], from[p[1]], from[p[2]], from[p[3]]};
#else
        v.r[i] = (DoubleRegister){from[p[0]], from[p[1]]};
#endif
    }
    return v;
}

// Uniforms of `index` and the seven after it: (bits / 4096 + 1/2) / 2^52, exact in each step.
HIL_INLINE D uniforms(const std::uint64_t key[2], std::uint64_t index) {
    std::uint64_t drawn[12];
    const std::uint64_t skip = index % 4;
    const std::uint64_t from = index - skip;
    for (std::uint64_t group = 0; group < (skip == 0 ? 2u : 3u); ++group) {
        const std::uint64_t at = from + 4 * group;
        // + 1, because numpy's generator increments its counter before it draws.
        const std::uint64_t counter[4] = {at % NoiseStream::kBlock / 4 + 1, 0, at / NoiseStream::kBlock, 0};
        philox(counter, key, drawn + 4 * group);
    }
    const L fraction = shift_right(load<L>((const std::int64_t *)drawn + skip), 12) & (std::int64_t)0xfffffffffffffLL;
    return (as<D>(fraction | (std::int64_t)0x3ff0000000000000LL) - 1.0) + 0x1p-53;
}

HIL_INLINE D polynomial(const double *coefficient, const D &x) {
    D v = splat<D>(coefficient[0]);
#pragma GCC unroll 8
    for (int i = 1; i < 8; ++i) v = v * x + coefficient[i];
    return v;
}

// Standard normals; lanes that are not `wanted` are undefined.
HIL_INLINE D normals(const D &uniform, unsigned wanted) {
    const D q = uniform - 0.5;
    const D r = 0.180625 - q * q;
    D v = q * (polynomial(normal_centre::kA, r) / polynomial(normal_centre::kB, r));
    unsigned outer = bits(abs(q) > splat<D>(normal_centre::kCentre)) & wanted;
    if (outer != 0) {
        double lane[kLanes], drawn[kLanes];
        store(lane, v), store(drawn, uniform);
        for (; outer != 0; outer &= outer - 1) {
            const int i = __builtin_ctz(outer);
            lane[i] = normal_from_uniform(drawn[i]);
        }
        v = load<D>(lane);
    }
    return v;
}

// Probability that an echo is not seen.
HIL_INLINE D loss(const LidarReceiver &receiver, const D &true_m, const D &strength) {
    const D zero = splat<D>(0.0), one = splat<D>(1.0);
    const D limit = receiver.range_at_10_percent_m * sqrt(strength / splat<D>(kReference));
    // A black surface has limit 0: its echo is lost.
    const D fraction = true_m / max(limit, splat<D>(1e-9));
    const D lost = min(max((fraction - kSure) / splat<D>(kNever - kSure), zero), one);
    return lost + (one - lost) * receiver.dropout;
}

std::size_t receive(const LidarReceiver &receiver, const LidarEchoes &in, std::uint64_t first,
                    const LidarCloud &cloud) {
    const bool limited = receiver.range_at_10_percent_m == receiver.range_at_10_percent_m;
    const bool falls = receiver.intensity_falloff_m == receiver.intensity_falloff_m;
    std::size_t found = 0;
    for (std::size_t at = 0; at < in.count; at += kLanes) {
        const int n = in.count - at < (std::size_t)kLanes ? (int)(in.count - at) : kLanes;
        std::int32_t place[kLanes];
        HIL_UNROLL for (int i = 0; i < kLanes; ++i) place[i] = in.place[at + (std::size_t)(i < n ? i : 0)];
        const D met_m = picked(in.range_m, place);
        const auto hit = abs(met_m) < splat<D>(kInf);
        unsigned kept = bits(hit) & ((1u << n) - 1);
        if (kept == 0) continue;
        const D strength = picked(in.strength, place);
        double range[kLanes], light[kLanes];
        const D true_m = select(hit, met_m, splat<D>(0.0));
        D measured = true_m;
        if (receiver.noise_m > 0.0) {
            measured = true_m + receiver.noise_m * normals(uniforms(receiver.noise_key, first + at), kept);
        }
        measured = whole(measured / splat<D>(receiver.resolution_m) + 0.5) * receiver.resolution_m;
        kept &= bits((measured >= splat<D>(receiver.min_range_m)) & (measured <= splat<D>(receiver.max_range_m)));
        if (kept == 0) continue;
        if (limited || receiver.dropout > 0.0) {
            const D lost = limited ? loss(receiver, true_m, strength) : splat<D>(receiver.dropout);
            // No draw if all echoes are lost with probability 1: a uniform is below 1.
            kept &= bits(lost < splat<D>(1.0));
            if (kept == 0) continue;
            kept &= bits(uniforms(receiver.loss_key, first + at) >= lost);
        }
        D intensity = strength;
        if (falls) {
            const D ratio = receiver.intensity_falloff_m / max(true_m, splat<D>(receiver.intensity_falloff_m));
            intensity = intensity * (ratio * ratio);
        }
        store(light, min(intensity, splat<D>(1.0)));
        store(range, measured);
        for (; kept != 0; kept &= kept - 1) {
            const int lane = __builtin_ctz(kept);
            const std::size_t i = at + (std::size_t)lane;
            const double *d = in.direction_L + 3 * i;
            float *p = cloud.points_L + 3 * found;
            p[0] = (float)(range[lane] * d[0]);
            p[1] = (float)(range[lane] * d[1]);
            p[2] = (float)(range[lane] * d[2] + in.origin_z_m[i]);
            cloud.range_m[found] = (float)range[lane];
            cloud.intensity[found] = (float)light[lane];
            cloud.ring[found] = in.ring[i];
            cloud.time_offset_ns[found] = in.time_offset_ns[i];
            cloud.geom_class[found] = in.geom_class[in.geom[in.place[i]]];
            if (cloud.ray != nullptr) cloud.ray[found] = (std::int32_t)i;
            ++found;
        }
    }
    return found;
}

}  // namespace

extern const ReceiveKernel receive_of_isa;
const ReceiveKernel receive_of_isa = receive;

}  // namespace hil::sim::frame::HIL_ISA
