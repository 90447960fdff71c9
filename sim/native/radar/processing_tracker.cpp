#include "processing_tracker.hpp"

#include <algorithm>
#include <cmath>

#include "detmath.hpp"

namespace hil::sim::radar {

namespace {

constexpr double kNepersPerDecibel = 0.230258509299404568402;  // ln 10 / 10
constexpr double kFirstRateSigma = 0.3;                        // of a direction sine, 1/s
constexpr double kRoundingS = 1e-6;                            // of times that were added up
constexpr double kNearestSine = 0.05;                          // of d_x, in deviations of angles

// A limb swings past the trunk's speed in a few frames, the trunk changes its own slowly: points this far from the
// speed that a track is expected to have count a quarter of what they would.
constexpr double kTrunkMps = 0.6;
// Of the points within this of the median speed the mean is taken: a median alone jumps from point to point.
constexpr double kRidgeMps = 0.25;

// Amplitude over noise: of a body that is spread out, its strongest point must not stand for all of it in range.
double weight_of(const RadarPoint &point) { return det::exp(0.5 * kNepersPerDecibel * point.snr_db); }
// Power over noise: in speed it must.
double power_of(const RadarPoint &point) { return det::exp(kNepersPerDecibel * point.snr_db); }

double sine_y(const RadarPoint &point) { return det::cos(point.elevation_rad) * det::sin(point.azimuth_rad); }
double sine_z(const RadarPoint &point) { return det::sin(point.elevation_rad); }

}  // namespace

void Tracker::Filter::predict(double dt, double q) {
    const double q2 = q * q;
    value += rate * dt;
    p00 += dt * (2.0 * p01 + dt * p11) + q2 * dt * dt * dt / 3.0;
    p01 += dt * p11 + q2 * dt * dt / 2.0;
    p11 += q2 * dt;
}

void Tracker::Filter::update_value(double innovation, double sigma) {
    const double s = p00 + sigma * sigma, k0 = p00 / s, k1 = p01 / s;
    value += k0 * innovation;
    rate += k1 * innovation;
    p11 -= k1 * p01;
    p01 *= 1.0 - k0;
    p00 *= 1.0 - k0;
}

void Tracker::Filter::update_rate(double innovation, double sigma) {
    const double s = p11 + sigma * sigma, k0 = p01 / s, k1 = p11 / s;
    value += k0 * innovation;
    rate += k1 * innovation;
    p00 -= k0 * p01;
    p01 *= 1.0 - k1;
    p11 *= 1.0 - k1;
}

Tracker::Tracker(const TrackerSettings &settings) : settings_(settings) {}

void Tracker::reset() {
    tracks_.clear();
    next_id_ = 1;
}

double Tracker::fold(double speed) const {
    return speed - settings_.whole_speed_mps * std::floor(speed / settings_.whole_speed_mps + 0.5);
}

// Of a track that was not seen for a while the speed may be any.
double Tracker::speed_gate(const Track &track) const {
    return settings_.gate_speed_mps + 2.0 * std::max(0.0, std::sqrt(track.range.p11) - settings_.speed_sigma_mps);
}

void Tracker::cluster(const RadarPoint *points, int count) {
    clusters_.clear();
    member_.assign(count, -1);
    for (int seed = 0; seed < count; ++seed) {
        if (member_[seed] >= 0) continue;
        const int index = (int)clusters_.size();
        queue_.assign(1, seed);
        member_[seed] = index;
        Cluster c{0.0, 0.0, 0.0, 0.0, 0.0, points[seed].snr_db, -1};
        for (std::size_t next = 0; next < queue_.size(); ++next) {
            const RadarPoint &p = points[queue_[next]];
            const double y = sine_y(p), z = sine_z(p), w = weight_of(p);
            c.weight += w;
            c.range += w * p.range_m;
            c.speed += w * fold(p.speed_mps - points[seed].speed_mps);
            c.y += w * y;
            c.z += w * z;
            c.snr_db = std::max(c.snr_db, (double)p.snr_db);
            for (int other = 0; other < count; ++other) {
                if (member_[other] >= 0) continue;
                const RadarPoint &o = points[other];
                const double dr = (o.range_m - p.range_m) / settings_.cluster_range_m;
                const double dv = fold(o.speed_mps - p.speed_mps) / settings_.cluster_speed_mps;
                if (dr * dr + dv * dv > 1.0) continue;
                const double dy = (sine_y(o) - y) / settings_.cluster_sine;
                if (dr * dr + dv * dv + dy * dy > 1.0) continue;
                member_[other] = index;
                queue_.push_back(other);
            }
        }
        c.range /= c.weight;
        c.speed = fold(points[seed].speed_mps + c.speed / c.weight);
        c.y /= c.weight;
        c.z /= c.weight;
        clusters_.push_back(c);
    }
}

void Tracker::assign() {
    for (Cluster &c : clusters_) {
        double nearest = 1.0;  // of the gate
        for (std::size_t t = 0; t < tracks_.size(); ++t) {
            const Track &track = tracks_[t];
            const double dr = (c.range - track.range.value) / settings_.gate_range_m;
            const double dy = (c.y - track.y.value) / settings_.gate_sine;
            const double dv = fold(c.speed - track.range.rate) / speed_gate(track);
            const double place = dr * dr + dy * dy;
            if (place > 1.0) continue;
            // Within the place of a track a cluster of any speed belongs to it: a limb is no new person.
            const double distance = 0.5 * place + std::min(0.5, 0.5 * dv * dv);
            if (distance < nearest || c.track < 0) {
                nearest = distance;
                c.track = (int)t;
            }
        }
    }
}

void Tracker::update(Track &track, int index, const RadarPoint *points, int count) {
    speeds_.clear();
    double total = 0.0, power = 0.0, range = 0.0, y = 0.0, z = 0.0;
    const double gate = speed_gate(track);
    for (int i = 0; i < count; ++i) {
        if (clusters_[member_[i]].track != index) continue;
        const double dv = fold(points[i].speed_mps - track.range.rate);
        if (std::fabs(dv) > gate) continue;
        const double w = weight_of(points[i]);
        total += w;
        range += w * points[i].range_m;
        y += w * sine_y(points[i]);
        z += w * sine_z(points[i]);
        const double near = 1.0 / (1.0 + dv * dv / (kTrunkMps * kTrunkMps));
        const double p = power_of(points[i]) * near * near;
        power += p;
        speeds_.push_back({dv, p});
    }
    if (speeds_.empty()) return;
    std::stable_sort(speeds_.begin(), speeds_.end(),
                     [](const Weighed &a, const Weighed &b) { return a.speed < b.speed; });
    double below = 0.0, median = 0.0;
    for (const Weighed &s : speeds_) {
        median = s.speed;
        below += s.weight;
        if (below >= 0.5 * power) break;
    }
    double ridge = 0.0, ridge_weight = 0.0;
    for (const Weighed &s : speeds_) {
        if (std::fabs(s.speed - median) > kRidgeMps) continue;
        ridge += s.weight * s.speed;
        ridge_weight += s.weight;
    }
    const double before = track.range.rate;
    track.range.update_value(range / total - track.range.value, settings_.range_sigma_m);
    track.range.update_rate(before + ridge / ridge_weight - track.range.rate, settings_.speed_sigma_mps);
    track.y.update_value(y / total - track.y.value, settings_.sine_sigma);
    track.z.update_value(z / total - track.z.value, settings_.sine_sigma);
    track.unseen_s = 0.0;
    ++track.hits;
}

void Tracker::give_birth() {
    for (std::size_t i = 0; i < clusters_.size(); ++i) {
        Cluster &c = clusters_[i];
        if (c.track >= 0 || c.snr_db < settings_.birth_snr_db) continue;
        if (std::fabs(c.speed) < settings_.birth_speed_mps) continue;
        // Not beside a track that began in this frame either.
        bool taken = false;
        for (const Track &t : tracks_) {
            const double dr = (c.range - t.range.value) / settings_.gate_range_m;
            const double dy = (c.y - t.y.value) / settings_.gate_sine;
            taken = taken || dr * dr + dy * dy <= 1.0;
        }
        if (taken) continue;
        const double rs = settings_.range_sigma_m, vs = settings_.speed_sigma_mps, ss = settings_.sine_sigma;
        const double rate2 = kFirstRateSigma * kFirstRateSigma;
        Track track;
        track.range = {c.range, c.speed, rs * rs, 0.0, vs * vs};
        track.y = {c.y, 0.0, ss * ss, 0.0, rate2};
        track.z = {c.z, 0.0, ss * ss, 0.0, rate2};
        tracks_.push_back(track);
    }
}

void Tracker::bury() {
    const auto ended = [&](const Track &t) {
        if (!(t.range.value > 0.0)) return true;
        if (t.id != 0) return t.unseen_s > settings_.coast_s + kRoundingS;
        return t.hits + (settings_.confirm_frames - t.age) < settings_.confirm_hits;
    };
    tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(), ended), tracks_.end());
    // Of two that came to the same place with the same speed the older remains.
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
        for (std::size_t j = tracks_.size() - 1; j > i; --j) {
            const Track &a = tracks_[i], &b = tracks_[j];
            const double dr = (a.range.value - b.range.value) / settings_.gate_range_m;
            const double dy = (a.y.value - b.y.value) / settings_.gate_sine;
            const double dv = fold(a.range.rate - b.range.rate) / settings_.gate_speed_mps;
            if (dr * dr + dy * dy + dv * dv < 0.25) tracks_.erase(tracks_.begin() + (long)j);
        }
    }
}

int Tracker::step(double dt_s, const RadarPoint *points, int count, RadarTrack *out, int room) {
    for (Track &t : tracks_) {
        // Unseen: it has probably stopped.
        if (t.unseen_s > 0.0) t.range.rate /= 1.0 + dt_s / settings_.pause_s;
        t.range.predict(dt_s, settings_.acceleration_mps2);
        t.y.predict(dt_s, settings_.sine_acceleration_ps2);
        t.z.predict(dt_s, settings_.sine_acceleration_ps2);
        t.unseen_s += dt_s;
        ++t.age;
    }
    cluster(points, count);
    assign();
    for (std::size_t i = 0; i < tracks_.size(); ++i) update(tracks_[i], (int)i, points, count);
    bury();
    give_birth();

    int given = 0;
    for (Track &t : tracks_) {
        if (t.id == 0 && t.hits >= settings_.confirm_hits) {
            t.id = next_id_;
            next_id_ = next_id_ == 65535 ? 1 : next_id_ + 1;
        }
        if (t.id == 0 || given == room) continue;
        const double across = std::sqrt(t.y.value * t.y.value + t.z.value * t.z.value);
        const double fit = across > 1.0 ? 1.0 / across : 1.0;
        const double dy = fit * t.y.value, dz = fit * t.z.value;
        const double rest = 1.0 - dy * dy - dz * dz;
        const double dx = std::sqrt(rest > 0.0 ? rest : 0.0);
        const double r = t.range.value, v = t.range.rate;
        const double forward = std::max(dx, kNearestSine), level = std::max(std::sqrt(dx * dx + dy * dy), kNearestSine);
        const double rate_x = -(dy * t.y.rate + dz * t.z.rate) / forward;
        out[given++] = {(std::uint16_t)t.id,
                        (std::uint16_t)std::min(t.age, 65535),
                        {(float)(r * dx), (float)(r * dy), (float)(r * dz)},
                        {(float)(v * dx + r * rate_x), (float)(v * dy + r * t.y.rate), (float)(v * dz + r * t.z.rate)},
                        (float)r,
                        (float)v,
                        (float)det::atan2(dy, dx),
                        (float)det::asin(dz),
                        (float)std::sqrt(t.range.p00),
                        (float)std::sqrt(t.range.p11),
                        (float)(std::sqrt(t.y.p00) / forward),
                        (float)(std::sqrt(t.z.p00) / level),
                        (float)t.unseen_s};
    }
    return given;
}

}  // namespace hil::sim::radar
