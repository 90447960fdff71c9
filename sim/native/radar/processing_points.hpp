// Peaks of a range-Doppler map as points: range, speed, direction, signal over noise.
//
// A peak is a cell above its CFAR threshold and above its eight neighbours. Between bins: with the amplitudes a-, a0,
// a+ of the cells beside it and W the spectrum of the window, an echo d bins off the cell has
//
//     (a+ - a-) / (a- + a0 + a+) = (|W(1 - d)| - |W(1 + d)|) / (|W(1 + d)| + |W(d)| + |W(1 - d)|)
//
// which grows with d: a table of it, read backwards, gives d without bias for any window and padding. An echo that
// moves shifts its beat by its Doppler frequency at the middle of the sweep, so with the slope S
//
//     R = range_step (k + d_range) - v f_c / S.
//
// A peak that is no higher than the side lobes of a stronger one may be there is left out: lobes in range and in
// Doppler are the two windows', so those of a peak form a cross about it, and another about its mirror image: samples
// are real, so an echo is at minus its range and minus its speed as well.
#pragma once

#include <cstdint>
#include <vector>

#include "cfar.hpp"
#include "processing_angles.hpp"
#include "processing_map.hpp"

namespace hil::sim::radar {

struct RadarPoint {
    float x_m, y_m, z_m;
    float range_m, speed_mps, azimuth_rad, elevation_rad, snr_db;
};
static_assert(sizeof(RadarPoint) == 32);

struct PeakSettings {
    double range_step_m, speed_step_mps;  // of a cell
    double coupling_s;                    // f_c / S
    int first_column = 1;                 // nearest peak that is reported
    // The ratio above at d = 0 ... 0.5 in equal steps, for each dimension.
    std::vector<double> range_ratio, speed_ratio;
    // Power, relative to the peak, that the window may leave that many cells away or farther, and where the first side
    // lobe begins.
    std::vector<double> range_lobes, speed_lobes;
    int range_null = 1, speed_null = 1;
};

class PeakFinder {
   public:
    PeakFinder(PeakSettings settings, Cfar cfar, Direction direction);

    // Points of the map that `map` made last, strongest first, at most `room`; returns how many.
    int find(const ProcessingMap &map, const float *power, RadarPoint *out, int room);

   private:
    struct Peak {
        float power;
        int row, column;
        double noise;
    };
    bool is_peak(const float *power, int row, int column) const;
    bool is_lobe(const Peak &peak, const Peak &stronger) const;

    PeakSettings settings_;
    Cfar cfar_;
    Direction direction_;
    std::vector<Peak> peaks_;
    std::vector<double> re_, im_;
};

// d of a ratio, from a table at d = 0 ... 0.5; odd, and no more than 0.5 either way.
double bins_off(const std::vector<double> &table, double ratio);

}  // namespace hil::sim::radar
