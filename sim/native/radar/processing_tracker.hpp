// Tracks of what moves, from the points of successive frames.
//
// State of a track: range and radial speed (r, v), and the direction sines d_y, d_z with their rates, each pair a
// Kalman filter with white acceleration q:
//
//     F = | 1 dt |     Q = q^2 | dt^3/3  dt^2/2 |
//         | 0  1 |             | dt^2/2  dt     |
//
// A frame: predict; put points together that lie near one another in range, speed and direction (a chain of neighbours
// is one cluster); each cluster goes to the nearest track within the gate; a track takes, of all its points, the mean
// range and direction weighed by amplitude and the median speed weighed by power, less so the farther from the speed it
// is expected to have (the trunk of a walker is the strongest ridge, limbs lie to both sides of it); clusters that no
// track takes begin tracks where they move. A track counts once it was seen in `confirm_hits` of its first
// `confirm_frames` frames, keeps its identity from then on, and ends when it was not seen for `coast_s`. Meanwhile its
// speed falls to zero with `pause_s`: what vanishes from the map has most likely stopped. Speeds are compared modulo
// `whole_speed_mps`, as the radar measures them.
#pragma once

#include <cstdint>
#include <vector>

#include "processing_points.hpp"

namespace hil::sim::radar {

struct TrackerSettings {
    double whole_speed_mps;
    double cluster_range_m, cluster_speed_mps, cluster_sine;
    double gate_range_m, gate_speed_mps, gate_sine;
    double birth_speed_mps, birth_snr_db;
    double range_sigma_m, speed_sigma_mps, sine_sigma;
    double acceleration_mps2, sine_acceleration_ps2;  // q, per square root of a second
    int confirm_hits, confirm_frames;
    double coast_s, pause_s;
};

struct RadarTrack {
    std::uint16_t id, age_frames;  // age since the first point; stays at its greatest value
    float p_R_m[3], v_R_mps[3];
    float range_m, speed_mps, azimuth_rad, elevation_rad;
    float range_std_m, speed_std_mps, azimuth_std_rad, elevation_std_rad;
    float unseen_s;
};
static_assert(sizeof(RadarTrack) == 64);

class Tracker {
   public:
    explicit Tracker(const TrackerSettings &settings);

    // `dt_s` since the last frame (ignored for the first). Confirmed tracks by rising age, at most `room`; returns how
    // many.
    int step(double dt_s, const RadarPoint *points, int count, RadarTrack *out, int room);
    void reset();

   private:
    struct Filter {  // value and rate
        double value, rate, p00, p01, p11;
        void predict(double dt, double q);
        void update_value(double innovation, double sigma);
        void update_rate(double innovation, double sigma);
    };
    struct Track {
        int id = 0;  // 0 until confirmed
        int age = 1, hits = 1;
        double unseen_s = 0.0;
        Filter range, y, z;
    };
    struct Cluster {
        double weight, range, speed, y, z, snr_db;
        int track;
    };

    double fold(double speed) const;
    double speed_gate(const Track &track) const;
    void cluster(const RadarPoint *points, int count);
    void assign();
    void update(Track &track, int index, const RadarPoint *points, int count);
    void give_birth();
    void bury();

    TrackerSettings settings_;
    std::vector<Track> tracks_;
    std::vector<Cluster> clusters_;
    std::vector<int> member_, queue_;
    struct Weighed {
        double speed, weight;
    };
    std::vector<Weighed> speeds_;
    int next_id_ = 1;
};

}  // namespace hil::sim::radar
