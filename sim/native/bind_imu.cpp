// sim._kernels.Imu: inertial errors and their noise. Contract: imu.hpp.

#include "bind_arrays.hpp"
#include "imu.hpp"

using hil::sim::kImuChannels;

namespace {

using Values = std::vector<double>;

constexpr int kMostRotors = 16;

template <std::size_t N>
void copy(const Values &source, double (&out)[N], const char *what) {
    if (source.size() != N) {
        throw std::invalid_argument(std::string(what) + " needs " + std::to_string(N) + " values, not " +
                                    std::to_string(source.size()));
    }
    for (std::size_t i = 0; i < N; ++i) out[i] = source[i];
}

class Imu {
  public:
    Imu(Key white_key, Key walk_key, Key flicker_key, const Values &accel_gain, const Values &gyro_gain,
        const Values &bias, const Values &white, const Values &walk_step, const Values &temperature_gain,
        const Values &temperature, const Values &lsb, const Values &word, const Values &limit,
        const Values &lever_arm_B_m, double step_s, double gravity_mps2, const Values &flicker_phi,
        const Values &flicker_start, const Values &flicker_step, const Values &order, const Values &amplitude,
        const Values &phase_cos, const Values &phase_sin, double reference_speed_radps)
        : imu_(params(accel_gain, gyro_gain, bias, white, walk_step, temperature_gain, temperature, lsb, word, limit,
                      lever_arm_B_m, step_s, gravity_mps2, flicker_phi, flicker_start, flicker_step, order, amplitude,
                      phase_cos, phase_sin, reference_speed_radps),
               white_key.data(), walk_key.data(), flicker_key.data()) {}

    nb::tuple sample(const nb::tuple &q_WB, const nb::tuple &a_WB_W, const nb::tuple &w_WB_B,
                     const nb::tuple &alpha_WB_B, const nb::tuple &rotor_speed_radps, std::int64_t t_ns,
                     std::uint64_t index) {
        hil::sim::ImuTruth truth;
        unpack(q_WB, truth.q_WB, "q_WB");
        unpack(a_WB_W, truth.a_WB_W, "a_WB_W");
        unpack(w_WB_B, truth.w_WB_B, "w_WB_B");
        unpack(alpha_WB_B, truth.alpha_WB_B, "alpha_WB_B");
        double speed[kMostRotors];
        truth.rotors = 0;
        if (imu_.needs_rotors()) {
            const std::size_t n = rotor_speed_radps.size();
            if (n > kMostRotors) throw std::invalid_argument("rotor_speed_radps must hold at most 16 rotors");
            for (std::size_t i = 0; i < n; ++i) {
                speed[i] = as_double(PyTuple_GetItem(rotor_speed_radps.ptr(), static_cast<Py_ssize_t>(i)));
            }
            truth.rotors = static_cast<int>(n);
        }
        truth.rotor_speed_radps = speed;
        truth.t_ns = t_ns;
        double out[kImuChannels + 1];
        imu_.sample(truth, index, out);
        return nb::make_tuple(nb::make_tuple(out[0], out[1], out[2]), nb::make_tuple(out[3], out[4], out[5]), out[6]);
    }

    void take_readings(const std::vector<int> &readings, const Values &low_pass_radps, const Values &g_sensitivity,
                       double rectification_s2pm, double step_s, const Values &order, const Values &cosine,
                       const Values &sine, double mount_radps, double mount_damping, const Values &broadband,
                       const Values &broadband_radps, double reference_radps, Key key) {
        hil::sim::ImuReadingsParams chain{};
        if (readings.size() != 2 || readings[0] < 1 || readings[1] < 1) {
            throw std::invalid_argument("readings needs two counts of at least 1");
        }
        chain.count[0] = readings[0];
        chain.count[1] = readings[1];
        copy(low_pass_radps, chain.low_pass_radps, "low_pass_radps");
        copy(g_sensitivity, chain.g_sensitivity, "g_sensitivity");
        chain.rectification_s2pm = rectification_s2pm;
        hil::sim::RotorVibrationParams p;
        const std::size_t one_rotor = order.size() * kImuChannels;
        if (one_rotor == 0 || cosine.size() != sine.size() || cosine.size() % one_rotor != 0) {
            throw std::invalid_argument("cosine and sine need 6 values for each rotor and line");
        }
        p.rotors = static_cast<int>(cosine.size() / one_rotor);
        if (p.rotors > kMostRotors) throw std::invalid_argument("at most 16 rotors shake a sensor");
        p.order = order;
        p.cosine = cosine;
        p.sine = sine;
        p.mount_radps = mount_radps;
        p.mount_damping = mount_damping;
        copy(broadband, p.broadband, "broadband");
        copy(broadband_radps, p.broadband_radps, "broadband_radps");
        p.reference_radps = reference_radps;
        for (int i = 0; i < 2; ++i) p.key[i] = key.data()[i];
        p.step_s = step_s;
        imu_.take_readings(chain, hil::sim::RotorVibration(std::move(p)));
    }

    nb::tuple clipped() const {
        const hil::sim::ImuReadings *readings = imu_.readings();
        std::uint64_t n[kImuChannels] = {};
        for (int i = 0; readings && i < kImuChannels; ++i) n[i] = readings->clipped()[i];
        return nb::make_tuple(n[0], n[1], n[2], n[3], n[4], n[5]);
    }

    void noise(std::uint64_t first, Out<double, -1, kImuChannels + 1> out) {
        nb::gil_scoped_release release;
        imu_.noise(first, out.shape(0), out.data());
    }

  private:
    static hil::sim::ImuErrorParams params(const Values &accel_gain, const Values &gyro_gain, const Values &bias,
                                           const Values &white, const Values &walk_step,
                                           const Values &temperature_gain, const Values &temperature,
                                           const Values &lsb, const Values &word, const Values &limit,
                                           const Values &lever_arm_B_m, double step_s, double gravity_mps2,
                                           const Values &flicker_phi, const Values &flicker_start,
                                           const Values &flicker_step, const Values &order, const Values &amplitude,
                                           const Values &phase_cos, const Values &phase_sin,
                                           double reference_speed_radps) {
        hil::sim::ImuErrorParams p;
        copy(accel_gain, p.gain[0], "accel_gain");
        copy(gyro_gain, p.gain[1], "gyro_gain");
        copy(bias, p.bias, "bias");
        copy(white, p.white, "white");
        copy(walk_step, p.walk_step, "walk_step");
        copy(temperature_gain, p.temperature_gain, "temperature_gain");
        double t[4];
        copy(temperature, t, "temperature");
        p.temperature_end_degc = t[0];
        p.temperature_rise_degc = t[1];
        p.temperature_reference_degc = t[2];
        p.warm_up_time_s = t[3];
        copy(lsb, p.lsb, "lsb");
        copy(word, p.word, "word");
        copy(limit, p.limit, "limit");
        copy(lever_arm_B_m, p.lever_arm_B_m, "lever_arm_B_m");
        p.step_s = step_s;
        p.gravity_mps2 = gravity_mps2;
        const std::size_t flicker = flicker_phi.size() * kImuChannels, harmonics = order.size() * kImuChannels;
        if (flicker_start.size() != flicker || flicker_step.size() != flicker) {
            throw std::invalid_argument("flicker steps must hold 6 values for each process");
        }
        if (amplitude.size() != harmonics || phase_sin.size() != phase_cos.size() ||
            (harmonics == 0 ? !phase_cos.empty() : phase_cos.size() % harmonics != 0)) {
            throw std::invalid_argument("vibration amplitudes and phases do not fit the harmonics");
        }
        p.flicker_phi = flicker_phi;
        p.flicker_start = flicker_start;
        p.flicker_step = flicker_step;
        p.order = order;
        p.amplitude = amplitude;
        p.phase_cos = phase_cos;
        p.phase_sin = phase_sin;
        p.reference_speed_radps = reference_speed_radps;
        return p;
    }

    hil::sim::Imu imu_;
};

}  // namespace

void bind_imu(nb::module_ &m) {
    nb::class_<Imu>(m, "Imu", "Inertial measurement unit: samples from truth. Equations and state: imu.hpp.")
        .def(nb::init<Key, Key, Key, const Values &, const Values &, const Values &, const Values &, const Values &,
                      const Values &, const Values &, const Values &, const Values &, const Values &, const Values &,
                      double, double, const Values &, const Values &, const Values &, const Values &, const Values &,
                      const Values &, const Values &, double>(),
             nb::kw_only(), "white_key"_a, "walk_key"_a, "flicker_key"_a, "accel_gain"_a, "gyro_gain"_a, "bias"_a,
             "white"_a, "walk_step"_a, "temperature_gain"_a, "temperature"_a, "lsb"_a, "word"_a, "limit"_a,
             "lever_arm_B_m"_a, "step_s"_a, "gravity_mps2"_a, "flicker_phi"_a, "flicker_start"_a, "flicker_step"_a,
             "order"_a, "amplitude"_a, "phase_cos"_a, "phase_sin"_a, "reference_speed_radps"_a)
        .def("sample", &Imu::sample, "q_WB"_a, "a_WB_W"_a, "w_WB_B"_a, "alpha_WB_B"_a, "rotor_speed_radps"_a, "t_ns"_a,
             "index"_a, "Return ((accel x, y, z), (gyro x, y, z), temperature).")
        .def("take_readings", &Imu::take_readings, nb::kw_only(), "readings"_a, "low_pass_radps"_a, "g_sensitivity"_a,
             "rectification_s2pm"_a, "step_s"_a, "order"_a, "cosine"_a, "sine"_a, "mount_radps"_a, "mount_damping"_a,
             "broadband"_a, "broadband_radps"_a, "reference_radps"_a, "key"_a,
             "Let the rotors shake the sensor. See imu_readings.hpp and rotor_vibration.hpp.")
        .def("clipped", &Imu::clipped, "Return the readings cut at full scale so far: accel x, y, z, gyro x, y, z.")
        .def("noise", &Imu::noise, "first"_a, "out"_a.noconvert(),
             "Fill `out` [count][7] with the noise of samples first .. first + count - 1, before rounding.");
}
