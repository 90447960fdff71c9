// sim._kernels.RigidBody: the rigid-body kernel bound to arrays that Python owns.
//
// Arrays are passed once, at construction, and kept alive; a tick then costs one call without array arguments. A call
// takes about a microsecond, so it holds the GIL.

#include <cmath>
#include <utility>

#include <nanobind/stl/pair.h>

#include "battery.hpp"
#include "bind_arrays.hpp"
#include "body.hpp"
#include "clearance.hpp"
#include "command_delay.hpp"
#include "downwash.hpp"
#include "free_flight.hpp"
#include "ideal_controller.hpp"
#include "forces/force_binding.hpp"
#include "forces/surfaced_force.hpp"
#include "rotation.hpp"

using hil::sim::Force;
using hil::sim::kMaxRotors;
using hil::sim::kPoseVelocity;
using hil::sim::SurfacedForce;

namespace {

class RigidBody {
  public:
    RigidBody(Out<double, -1> truth, double mass_kg, Vec3 inertia_kgm2, Vec3 inertia_products_kgm2, nb::list forces, double gravity_mps2,
              Vec3 wind_W_mps, double tick_s, int substeps, int contact_substeps, int hard_contact_substeps,
              bool classical)
        : truth_(truth), kept_(forces), times_{tick_s, substeps, classical, {contact_substeps, hard_contact_substeps}} {
        if (!(tick_s > 0.0) || substeps < 1 || contact_substeps < 1 || hard_contact_substeps < 1) {
            throw std::invalid_argument("tick and sub-step counts must be above zero");
        }
        body_.inertia = hil::sim::inertia_of(mass_kg, inertia_kgm2.data(), inertia_products_kgm2.data());
        body_.gravity_mps2 = gravity_mps2;
        body_.states = kPoseVelocity;
        body_.commands = 0;
        body_.integrals = 0;
        for (nb::handle item : forces) {
            auto *force = nb::cast<Force *>(item);
            if (force->attached) throw std::invalid_argument("a force belongs to one body only");
            body_.forces.push_back(force);
            body_.first_state.push_back(body_.states);
            body_.states += force->states();
            body_.commands += force->commands();
            body_.integrals += force->integrals();
            electric_ = electric_ || force->electric();
            body_.has_slipstreams = body_.has_slipstreams || force->feels_slipstreams();
        }
        if (body_.integrals > hil::sim::kMostIntegrals) throw std::invalid_argument("too many integrated values");
        if (truth.shape(0) != static_cast<std::size_t>(body_.states) + 6) {
            throw std::invalid_argument("truth must hold 13 + own states of the forces + 6 values");
        }
        for (Force *force : body_.forces) {
            force->attached = true;
            force->prepare(times_, body_.inertia);
        }
        set_wind(wind_W_mps, wind_W_mps);
        make_room(1 + body_.commands);
        before_.resize(body_.states);
        part_before_.resize(body_.states);
        commanded_.resize(body_.commands);
        remember();
    }

    void fit_battery(Out<double, -1> battery, double cells, double capacity_c, double resistance_ohm, double efficiency,
                     double auxiliary_w, double nominal_voltage_v) {
        if (battery.shape(0) != 4) throw std::invalid_argument("battery must hold 4 values");
        battery_ = battery;
        rated_ = pack_ = {true, cells, capacity_c, resistance_ohm, efficiency, auxiliary_w, nominal_voltage_v};
        if (thermal_.fitted) pack_ = thermal_.pack_at(rated_, battery_.data()[3]);
        battery_.data()[1] = hil::sim::loaded_v(pack_, battery_.data()[0], 0.0);
    }

    void fit_battery_thermal(double cells_ohm, double leads_ohm, double reference_degc, double activation_k,
                             double heat_capacity_j_per_k, double cooling_w_per_k, double ambient_degc,
                             const std::vector<double> &table_degc, const std::vector<double> &table_share) {
        if (table_degc.size() != table_share.size() || table_degc.size() > hil::sim::BatteryThermal::kMostPoints) {
            throw std::invalid_argument("the capacity's table needs as many shares as temperatures, at most 16");
        }
        thermal_ = {true, cells_ohm, leads_ohm, reference_degc + hil::sim::kZeroDegC_k, activation_k,
                    heat_capacity_j_per_k, cooling_w_per_k, ambient_degc, static_cast<int>(table_degc.size()), {}, {}};
        for (std::size_t i = 0; i < table_degc.size(); ++i) {
            thermal_.table_degc[i] = table_degc[i];
            thermal_.table_share[i] = table_share[i];
        }
    }

    double battery_capacity_c() const { return pack_.capacity_c; }

    void delay_commands(double dead_time_s, int first, int count) {
        if (!(dead_time_s >= 0.0) || first < 0 || count < 0 || first + count > body_.commands) {
            throw std::invalid_argument("a dead time must be 0 or more, for commands that the forces take");
        }
        delay_ = hil::sim::CommandDelay(dead_time_s, times_.tick_s, body_.commands, first, count);
        make_room(2 + body_.commands);
    }

    void forget_commands() { delay_.forget(); }

    void set_air(double site_altitude_m, double warmer_k) {
        body_.air = hil::sim::AirDensity(site_altitude_m, warmer_k);
    }

    double density_ratio() const { return body_.air.ratio(state()[2]); }

    void set_wind(Vec3 start_W_mps, Vec3 end_W_mps) {
        wind_.changes = false;
        for (int j = 0; j < 3; ++j) {
            wind_.start_W[j] = start_W_mps[j];
            wind_.slope_W[j] = (end_W_mps[j] - start_W_mps[j]) / times_.tick_s;
            wind_.changes = wind_.changes || wind_.slope_W[j] != 0.0;
        }
    }

    // Latches this tick's commands. Returns -1, or the index of the first value that is not finite.
    int command(nb::handle controls) {
        read_commands(controls);
        return latch(commanded_.data());
    }

    nb::tuple steady_wrench(nb::handle controls) {
        if (command(controls) >= 0) throw std::invalid_argument("a command is not finite");
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            double *own = state() + body_.first_state[k];
            body_.forces[k]->settle(own);
            body_.forces[k]->at_instant(own);
        }
        hil::sim::Instant now;
        hil::sim::Wrench wrench;
        hil::sim::wrench_at(body_, state(), wind_.start_W, now, wrench);
        const double *f = wrench.force_B, *m = wrench.torque_B;
        return nb::make_tuple(f[0], f[1], f[2], m[0], m[1], m[2]);
    }

    void read_commands(nb::handle controls) {
        PyObject *values = PySequence_Tuple(controls.ptr());  // returns the object itself if it is a tuple
        if (!values) throw nb::python_error();
        const nb::object keep = nb::steal(values);
        if (PyTuple_Size(values) < body_.commands) {
            throw std::invalid_argument("fewer controls than the forces take");
        }
        for (int i = 0; i < body_.commands; ++i) commanded_[i] = as_double(PyTuple_GetItem(values, i));
    }

    int latch(const double *controls) {
        voltage_ = 1.0;
        if (delay_.on()) {
            const int bad = delay_.push(controls);
            if (bad >= 0) return bad;
            controls = delay_.first();
        }
        if (pack_.fitted) {
            if (thermal_.fitted) pack_ = thermal_.pack_at(rated_, battery_.data()[3]);
            double *battery = battery_.data(), power_w = 0.0;
            hil::sim::Instant now;
            hil::sim::instant_at(body_, state(), wind_.start_W, now);
            pose();
            for (std::size_t k = 0; k < body_.forces.size(); ++k) {
                power_w += body_.forces[k]->power_w(now, state() + body_.first_state[k]);
            }
            battery[1] = electric_ ? hil::sim::supplied_v(pack_, battery[0], power_w,
                                                          [&](double share, double &slope) {
                                                              return supply_a(controls, share, slope);
                                                          })
                                   : hil::sim::loaded_v(pack_, battery[0], power_w);
            voltage_ = battery[1] / pack_.nominal_voltage_v;
        }
        return command_forces(controls);
    }

    void pose() const {
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            body_.forces[k]->pose(state() + body_.first_state[k]);
        }
    }

    // Current of the forces at V / V_nominal; adds its derivative.
    double supply_a(const double *controls, double share, double &per_share_a) const {
        double sum = 0.0;
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            const Force &force = *body_.forces[k];
            if (force.electric()) sum += force.supply_a(controls, state() + body_.first_state[k], share, per_share_a);
            controls += force.commands();
        }
        return sum;
    }

    int command_forces(const double *controls) {
        int first = 0;
        for (Force *force : body_.forces) {
            const int bad = force->command(controls + first, voltage_);
            if (bad >= 0) return first + bad;
            first += force->commands();
        }
        return -1;
    }

    double fly() {
        remember();
        in_parts_ = (delay_.splits() && delay_.changes()) || (!times_.classical && corner_s(times_.tick_s) > 0.0);
        if (in_parts_) return fly_in_parts();
        return hil::sim::free_flight_tick(body_, times_, wind_, state(), path_.data(), steps_);
    }

    // A tick in which the delayed commands change, or the motion of a force has a corner: a flight up to each, and one from
    // the last. Each is smooth, so the integrator keeps its order.
    double fly_in_parts() {
        double travelled_m = 0.0, begin_s = 0.0;
        int steps = 0;
        bool changes = delay_.splits() && delay_.changes();  // still to come
        work_j_ = charge_c_ = 0.0;
        for (int part = 0; part < parts_; ++part) {
            const double left_s = times_.tick_s - begin_s;
            double length_s = changes ? delay_.change_s() - begin_s : left_s;
            const double corner = part + (changes ? 2 : 1) < parts_ ? corner_s(length_s) : 0.0;
            const bool to_corner = corner > 0.0;
            if (to_corner) length_s = corner;
            hil::sim::StepTimes times = times_;
            times.tick_s = length_s;
            prepare(times);
            hil::sim::TickWind wind = wind_;
            for (int j = 0; j < 3; ++j) wind.start_W[j] += begin_s * wind_.slope_W[j];
            for (int k = kPoseVelocity; k < body_.states; ++k) part_before_[k] = state()[k];
            travelled_m += hil::sim::free_flight_tick(body_, times, wind, state(), path_.data() + 7 * steps, steps_);
            steps += steps_;
            if (pack_.fitted) work_j_ += work_j(part_before_.data());
            charge_c_ += charge_c();
            if (!to_corner && !changes) break;
            begin_s = to_corner ? begin_s + length_s : delay_.change_s();
            if (!to_corner) {
                command_forces(delay_.second());
                changes = false;
            }
        }
        steps_ = steps;
        prepare(times_);
        return travelled_m;
    }

    // Takes the way of a tick from what remains of the clearances. False, and nothing is taken, where it is too long.
    bool keeps_clear(double travelled_m) {
        if (!(travelled_m < remaining_m && travelled_m < actors_remaining_m)) return false;
        remaining_m -= travelled_m;
        actors_remaining_m -= travelled_m + approach_m;
        return true;
    }

    // Result of a cruise.
    struct Cruise {
        int done = 0;               // ticks finished
        double travelled_m = -1.0;  // of a tick flown but not finished
        int violation = 0, bad = -1;
    };

    // Flies up to `ticks` ticks with the commands latched last, or with those of a controller, while each travels less
    // than what remains of the clearance to the scene and to actors. A tick that travels farther is flown but not
    // finished, and ends the cruise.
    Cruise cruise(hil::sim::IdealController *controller, const double *commands, int ticks) {
        if (controller && controller->params.allocation.rotors != body_.commands) {
            throw std::invalid_argument("the controller is that of another vehicle");
        }
        Cruise out;
        if (!controller) out.bad = latch(commands);
        while (out.bad < 0 && out.violation == 0 && out.done < ticks) {
            if (controller) {
                const double *s = state(), *mean = s + before_.size();
                double wanted[kMaxRotors];
                controller->step({s, s + 3, s + 7, s + 10, mean, mean + 3, s + kPoseVelocity, touching}, wanted);
                out.bad = latch(wanted);
                if (out.bad >= 0) break;
            }
            const double travelled_m = fly();
            if (!keeps_clear(travelled_m)) {
                out.travelled_m = travelled_m;
                break;
            }
            touching = false;
            out.violation = finish();
            ++out.done;
            if (!controller && (pack_.fitted || delay_.on()) && out.done < ticks) out.bad = latch(commands);
        }
        return out;
    }

    int commands() const { return body_.commands; }

    nb::tuple cruise_with(nb::handle controls, int ticks) {
        Cruise out;
        if (nb::isinstance<hil::sim::IdealController>(controls)) {
            out = cruise(nb::inst_ptr<hil::sim::IdealController>(controls), nullptr, ticks);
        } else {
            read_commands(controls);
            out = cruise(nullptr, commanded_.data(), ticks);
        }
        return nb::make_tuple(out.done, out.travelled_m, out.violation, out.bad);
    }

    void repair() {
        for (Force *force : body_.forces) force->repair();
    }

    // Writes what a flight to targets is observed and judged by; see the binding.
    void observe(const double *target_W, int targets, const double *scale, float *features, double *measures) const {
        const double *s = state();
        double R[9];
        hil::rotation_matrix(s + hil::sim::kQ, R);
        int at = 0;
        const auto put = [&](double value) {
            features[at++] = static_cast<float>(value < -1.0 ? -1.0 : value > 1.0 ? 1.0 : value);
        };
        const auto put_turned = [&](const double *v, double factor) {  // v in W, written in B
            for (int j = 0; j < 3; ++j) put(((R[j] * v[0] + R[3 + j] * v[1]) + R[6 + j] * v[2]) * factor);
        };
        for (int k = 0; k < targets; ++k) {
            double e[3];
            for (int j = 0; j < 3; ++j) e[j] = target_W[3 * k + j] - s[j];
            put_turned(e, scale[0]);
            if (k == 0) measures[0] = std::sqrt((e[0] * e[0] + e[1] * e[1]) + e[2] * e[2]);
        }
        put_turned(s + 7, scale[1]);
        for (int j = 0; j < 3; ++j) put(s[10 + j] * scale[2]);
        for (int k = 0; k < 9; ++k) put(R[k]);
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            const Force &force = *body_.forces[k];
            for (int i = 0; i < force.states(); ++i) put(s[body_.first_state[k] + i] / force.full_scale(i));
        }
        measures[1] = std::sqrt((s[7] * s[7] + s[8] * s[8]) + s[9] * s[9]);
        measures[2] = std::sqrt((s[10] * s[10] + s[11] * s[11]) + s[12] * s[12]);
        measures[3] = R[8];
    }

    int own_states() const { return body_.states - kPoseVelocity; }

    int steps() const { return steps_; }

    void rewind() {
        in_parts_ = false;
        for (std::size_t k = 0; k < before_.size(); ++k) state()[k] = before_[k];
    }

    // Mean accelerations over the tick, charge drawn; returns the range code.
    int finish() {
        double *mean = state() + before_.size();
        const double *s = state();
        for (int j = 0; j < 6; ++j) mean[j] = (s[7 + j] - before_[7 + j]) / times_.tick_s;
        if (pack_.fitted) draw();
        return range_violation();
    }

    double clearance_before(double radius_m, const hil::sim::SolidTree &solids) const {
        return hil::sim::clearance(before_.data(), radius_m, solids);
    }

    nb::tuple position_before() const { return nb::make_tuple(before_[0], before_[1], before_[2]); }

    void attach(Out<double, -1> qpos, Out<double, -1> qvel, Out<double, -1> qfrc_applied, Out<double, -1> qacc) {
        if (qpos.shape(0) != 7 || qvel.shape(0) != 6 || qfrc_applied.shape(0) != 6 || qacc.shape(0) != 6) {
            throw std::invalid_argument("the MuJoCo model must have one free joint and no other joint");
        }
        qpos_ = qpos;
        qvel_ = qvel;
        qfrc_applied_ = qfrc_applied;
        qacc_ = qacc;
    }

    // Writes the pose at `share` of a sub-step to qpos: 0 is the pose before it, 1 exactly the pose after it. Between
    // them it is interpolated linearly, with an error of a h^2 / 8.
    void pose_in_substep(int substep, double share) {
        if (substep < 0 || substep >= steps_) throw nb::index_error("sub-step index is out of range");
        const double *to = path_.data() + 7 * static_cast<std::size_t>(substep);
        double *q = qpos_.data();
        if (share == 1.0) {
            for (int k = 0; k < 7; ++k) q[k] = to[k];
            return;
        }
        const double *from = substep == 0 ? before_.data() : to - 7;
        for (int k = 0; k < 7; ++k) q[k] = from[k] + share * (to[k] - from[k]);
        hil::sim::normalise_quaternion(q + 3);
    }

    // Length of the path in a sub-step.
    double way_in_substep(int substep) const {
        if (substep < 0 || substep >= steps_) throw nb::index_error("sub-step index is out of range");
        const double *to = path_.data() + 7 * static_cast<std::size_t>(substep);
        const double *from = substep == 0 ? before_.data() : to - 7;
        const double d[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
        return std::sqrt((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]);
    }

    // Writes the pose at `share` of the tick to qpos, interpolated linearly between its start and the state now: after
    // contact steps there is no path. Over 4 ms at 20 m/s2 and 20 rad/s the error is 40 um and 0.8 mrad.
    void pose_in_tick(double share) {
        double *q = qpos_.data();
        for (std::size_t k = 0; k < 7; ++k) q[k] = before_[k] + share * (state()[k] - before_[k]);
        hil::sim::normalise_quaternion(q + 3);
    }

    // Adds the wind that the wakes of this vehicle make at other places: wind_W_mps [n][3], less its own row.
    void add_wakes(const std::vector<const RigidBody *> &all, double *wind_W_mps) const {
        double wind[3];
        for (int j = 0; j < 3; ++j) wind[j] = wind_.start_W[j] + times_.tick_s * wind_.slope_W[j];
        pose();
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            hil::sim::Jet jet;
            if (!body_.forces[k]->jet(state(), state() + body_.first_state[k], wind, jet)) continue;
            for (std::size_t j = 0; j < all.size(); ++j) {
                if (all[j] != this) hil::sim::add_jet(jet, all[j]->position_W(), wind_W_mps + 3 * j);
            }
        }
    }

    const double *position_W() const { return state(); }
    const double *start_W() const { return before_.data(); }
    // Length of the path of pose_in_tick().
    double moved_m() const {
        const double d[3] = {state()[0] - before_[0], state()[1] - before_[1], state()[2] - before_[2]};
        return std::sqrt((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]);
    }

    // `substep`, counted from 0, selects the time at which the wind is taken.
    void contact_load(int substep, bool hard) {
        const double *s = state();
        const double h = times_.contact_s(hard);
        if (delay_.splits()) {  // at the nearest border of sub-steps: a sub-step is of order 1
            if (substep == 0) command_forces(delay_.first());
            if (substep == static_cast<int>(delay_.change_s() / h + 0.5)) command_forces(delay_.second());
        }
        double wind[3];
        for (int j = 0; j < 3; ++j) wind[j] = wind_.start_W[j] + substep * h * wind_.slope_W[j];
        for (int k = 0; k < 7; ++k) qpos_.data()[k] = s[k];
        for (int k = 0; k < 6; ++k) qvel_.data()[k] = s[7 + k];
        const auto wrench = hil::sim::contact_wrench(body_, hard, wind, s);
        hil::rotate_into_world(s + 3, wrench.force_B, qfrc_applied_.data());
        for (int k = 0; k < 3; ++k) qfrc_applied_.data()[3 + k] = wrench.torque_B[k];
    }

    void contact_update(bool hard) {
        hil::sim::contact_update(body_, hard, times_.contact_s(hard), qacc_.data(), state());
    }

    // For comparison only: the forces of this vehicle as MuJoCo's control callback, with their own states as MuJoCo's
    // activations. One vehicle at a time in a process.
    void serve_mujoco(Out<double, -1> qpos, Out<double, -1> qvel, Out<double, -1> act, Out<double, -1> qfrc_applied) {
        if (qpos.shape(0) != 7 || qvel.shape(0) != 6 || qfrc_applied.shape(0) != 6 ||
            act.shape(0) != before_.size() - kPoseVelocity) {
            throw std::invalid_argument("the MuJoCo model must have one free joint and an activation for each own state of a force");
        }
        qpos_ = qpos;
        qvel_ = qvel;
        act_ = act;
        qfrc_applied_ = qfrc_applied;
        served_ = this;
    }

    static std::uintptr_t mujoco_callback() { return reinterpret_cast<std::uintptr_t>(&RigidBody::on_mujoco_control); }

    // What remains of the clearances that were computed last, and how actors approach in a tick. The vehicle touched
    // something in the last complete tick.
    double remaining_m = 0.0, actors_remaining_m = 0.0, approach_m = 0.0;
    bool touching = false;

  private:
    static void on_mujoco_control(const void *, void *) {
        RigidBody &body = *served_;
        double s[kPoseVelocity];
        for (int k = 0; k < 7; ++k) s[k] = body.qpos_.data()[k];
        for (int k = 0; k < 6; ++k) s[7 + k] = body.qvel_.data()[k];
        for (std::size_t k = 0; k < body.body_.forces.size(); ++k) {
            body.body_.forces[k]->at_instant(body.act_.data() + (body.body_.first_state[k] - kPoseVelocity));
        }
        hil::sim::Instant now;
        hil::sim::Wrench wrench;
        hil::sim::wrench_at(body.body_, s, body.wind_.start_W, now, wrench);
        hil::rotate_into_world(s + 3, wrench.force_B, body.qfrc_applied_.data());
        for (int k = 0; k < 3; ++k) body.qfrc_applied_.data()[3 + k] = wrench.torque_B[k];
    }

    double *state() { return truth_.data(); }
    const double *state() const { return truth_.data(); }
    void remember() {
        for (std::size_t k = 0; k < before_.size(); ++k) before_[k] = state()[k];
    }

    // Room for the path of a tick in so many parts.
    void make_room(int parts) {
        parts_ = parts;
        path_.resize(7 * static_cast<std::size_t>(parts) *
                     (static_cast<std::size_t>(times_.base) << (hil::sim::kLevels - 1)));
    }

    // Time to the next corner of the forces' motion in the next `within_s` of flight; 0: none.
    double corner_s(double within_s) const {
        const double least = kLeastPart * times_.tick_s, most = within_s - least;
        double first = 0.0;
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            const double corner = body_.forces[k]->corner_s(state() + body_.first_state[k]);
            if (corner > least && corner < most && (!(first > 0.0) || corner < first)) first = corner;
        }
        return first;
    }

    void prepare(const hil::sim::StepTimes &times) {
        for (Force *force : body_.forces) force->prepare(times, body_.inertia);
    }

    // Work of the forces over the tick, or part of one, for which they are prepared.
    double work_j(const double *before) const {
        double sum = 0.0;
        for (std::size_t k = 0; k < body_.forces.size(); ++k) {
            sum += body_.forces[k]->work_j(before + body_.first_state[k]);
        }
        return sum;
    }

    // Charge that the forces took themselves.
    double charge_c() const {
        double sum = 0.0;
        for (const Force *force : body_.forces) sum += force->charge_c();
        return sum;
    }

    void draw() {
        const double work = in_parts_ ? work_j_ : work_j(before_.data());
        double *battery = battery_.data();
        const double shaft_c = (work / pack_.efficiency + pack_.auxiliary_w * times_.tick_s) / battery[1];
        const double drawn_c = shaft_c + (in_parts_ ? charge_c_ : charge_c());
        battery[0] += drawn_c;
        battery[2] = drawn_c / times_.tick_s;
        if (thermal_.fitted) battery[3] = thermal_.after(battery[3], battery[2], times_.tick_s);
    }

    // 0 in range; else the violated limit: 1 not finite, 2 speed, 3 body rate, 4 position, 5 no voltage left, 6 battery
    // empty.
    int range_violation() const {
        const double *s = state();
        const std::size_t n = before_.size() + 6;
        if (pack_.fitted) {
            if (!(battery_.data()[1] > 0.0)) return 5;
            if (!(battery_.data()[0] <= pack_.capacity_c)) return 6;
        }
        for (std::size_t k = 0; k < n; ++k) {
            if (!std::isfinite(s[k])) return 1;
        }
        if (s[7] * s[7] + s[8] * s[8] + s[9] * s[9] > 200.0 * 200.0) return 2;
        if (s[10] * s[10] + s[11] * s[11] + s[12] * s[12] > 200.0 * 200.0) return 3;
        if (s[0] * s[0] + s[1] * s[1] + s[2] * s[2] > 50.0e3 * 50.0e3) return 4;
        return 0;
    }

    inline static RigidBody *served_ = nullptr;
    Out<double, -1> truth_, battery_, qpos_, qvel_, act_, qfrc_applied_, qacc_;
    nb::object kept_;  // the forces
    std::vector<double> path_, before_, part_before_, commanded_;
    hil::sim::Body body_{};
    hil::sim::BatteryParams pack_, rated_;  // as it is now, and at the reference temperature
    hil::sim::BatteryThermal thermal_;
    hil::sim::CommandDelay delay_;
    double voltage_ = 1.0;    // over the nominal one, at the start of the tick
    double work_j_ = 0.0, charge_c_ = 0.0;  // of a tick flown in parts
    bool electric_ = false;   // a force takes its current itself
    bool in_parts_ = false;
    static constexpr double kLeastPart = 1e-9;  // of a tick: shorter ones are rounding
    int parts_ = 1;  // of a tick at most: one ends at each corner of a commanded motion, and where delayed commands change
    hil::sim::StepTimes times_{};
    hil::sim::TickWind wind_{};
    int steps_ = 0;
};

RigidBody &body_in(nb::handle item) {
    if (!nb::isinstance<RigidBody>(item)) throw nb::type_error("bodies must be a list of RigidBody");
    return *nb::inst_ptr<RigidBody>(item);
}

// Pairs of bodies whose bounding spheres can have met on the way of pose_in_tick(). All pairs are compared: 3 ns each.
std::vector<std::pair<int, int>> near_pairs(nb::list bodies, In<double, -1> radius_m) {
    const std::size_t n = bodies.size();
    if (radius_m.shape(0) != n) throw std::invalid_argument("each body needs a radius");
    struct Sphere {
        double x, y, z, reach;
    };
    std::vector<Sphere> spheres(n);
    for (std::size_t i = 0; i < n; ++i) {
        const RigidBody &body = body_in(bodies[i]);
        const double *p = body.start_W();
        spheres[i] = {p[0], p[1], p[2], radius_m.data()[i] + body.moved_m() + 0.5 * hil::sim::kClearanceSlack_m};
    }
    std::vector<std::pair<int, int>> near;
    for (std::size_t i = 0; i < n; ++i) {
        const Sphere a = spheres[i];
        for (std::size_t j = i + 1; j < n; ++j) {
            const Sphere &b = spheres[j];
            const double dx = b.x - a.x, dy = b.y - a.y, dz = b.z - a.z, reach = a.reach + b.reach;
            if ((dx * dx + dy * dy) + dz * dz < reach * reach) {
                near.emplace_back(static_cast<int>(i), static_cast<int>(j));
            }
        }
    }
    return near;
}

void write_downwash(nb::list bodies, Out<double, -1, 3> wind_W) {
    std::vector<const RigidBody *> all;
    for (nb::handle item : bodies) all.push_back(&body_in(item));
    if (wind_W.shape(0) != all.size()) throw std::invalid_argument("wind_W_mps needs a row for each body");
    for (std::size_t k = 0; k < 3 * all.size(); ++k) wind_W.data()[k] = 0.0;
    for (const RigidBody *upper : all) upper->add_wakes(all, wind_W.data());
}

// Cruises of many bodies, each alone in its world; see the binding.
constexpr std::size_t kCruise = 4;

void cruise_flights(nb::list bodies, nb::list controllers, In<double, -1, -1> commands, In<bool, -1> flies, int ticks,
                    double speed_limit_mps, Out<double, -1, kCruise> out) {
    using hil::sim::Target;
    const std::size_t n = bodies.size(), width = commands.shape(1);
    const bool controlled = controllers.size() > 0;
    if (commands.shape(0) != n || flies.shape(0) != n || out.shape(0) != n || (controlled && controllers.size() != n)) {
        throw std::invalid_argument("controllers, commands, flies and out need a row for each body");
    }
    for (std::size_t i = 0; i < n; ++i) {
        if (!flies.data()[i]) continue;
        RigidBody &body = body_in(bodies[i]);
        const double *row = commands.data() + width * i;
        hil::sim::IdealController *controller = nullptr;
        if (controlled) {
            if (width != 4) throw std::invalid_argument("a set-point has three rates and a thrust");
            controller = &nb::cast<hil::sim::IdealController &>(controllers[i]);
            Target &target = controller->target;
            target.level = Target::kRates;
            target.level_value[0] = row[0];
            target.level_value[1] = row[1];
            target.turns = true;
            target.yaw_value = row[2];
            target.height = Target::kThrust;
            target.height_value = row[3];
            target.speed_limit_mps = speed_limit_mps;
        } else if (width < static_cast<std::size_t>(body.commands())) {
            throw std::invalid_argument("fewer controls than the forces take");
        }
        const RigidBody::Cruise flown = body.cruise(controller, row, ticks);
        double *result = out.data() + kCruise * i;
        result[0] = flown.done;
        result[1] = flown.travelled_m;
        result[2] = flown.violation;
        result[3] = flown.bad;
    }
}

constexpr std::size_t kMeasures = 4;

void observe_flights(nb::list bodies, In<double, -1, -1, 3> target_W, Vec3 scale, Out<float, -1, -1> features,
                     Out<double, -1, kMeasures> measures) {
    const std::size_t n = bodies.size(), targets = target_W.shape(1), width = features.shape(1);
    if (target_W.shape(0) != n || features.shape(0) != n || measures.shape(0) != n || targets < 1) {
        throw std::invalid_argument("target_W_m, features and measures need a row for each body, and a target each");
    }
    for (std::size_t i = 0; i < n; ++i) {
        const RigidBody &body = body_in(bodies[i]);
        if (3 * targets + 15 + static_cast<std::size_t>(body.own_states()) > width) {
            throw std::invalid_argument("features needs 3 columns for each target, 15 and one for each own state of a force");
        }
        body.observe(target_W.data() + 3 * targets * i, static_cast<int>(targets), scale.data(),
                     features.data() + width * i, measures.data() + kMeasures * i);
    }
}

}  // namespace

void bind_body(nb::module_ &m) {
    using hil::sim::SolidTree;
    nb::class_<Force>(m, "Force", "What acts on a body; see forces/force.hpp.")
        .def_prop_ro("states", &Force::states, "Number of own states, which follow those of the body in `truth`.")
        .def_prop_ro("commands", &Force::commands, "Number of commands that it takes in every tick.")
        .def(
            "is_signed",
            [](const Force &self, int command) {
                if (command < 0 || command >= self.commands()) throw nb::index_error("command index is out of range");
                return self.is_signed(command);
            },
            "command"_a, "Return True for a command of -1..1, False for one of 0..1.");
    nb::enum_<hil::sim::SurfaceState>(m, "SurfaceState", "State of a control surface; see forces/servos.hpp.")
        .value("HEALTHY", hil::sim::SurfaceState::kHealthy)
        .value("STUCK", hil::sim::SurfaceState::kStuck)
        .value("FLOATING", hil::sim::SurfaceState::kFloating)
        .value("LOST", hil::sim::SurfaceState::kLost);
    nb::class_<SurfacedForce, Force>(m, "SurfacedForce",
                                     "Force with control surfaces. Own states: their deflections [rad].")
        .def(
            "set_surface",
            [](SurfacedForce &self, int surface, hil::sim::SurfaceState state, double stuck_rad) {
                if (surface < 0 || surface >= self.commands()) throw nb::index_error("surface index is out of range");
                self.set_surface(surface, state, stuck_rad);
            },
            "surface"_a, "state"_a, "stuck_rad"_a = 0.0, "Set the state of a surface from the next tick on.");
    for (const ForceBinding *force = ForceBinding::first; force; force = force->next) force->bind(m);

    nb::class_<SolidTree>(m, "SolidTree",
                          "Tree of static solid shapes: kind [n] (mjtGeom), pose [n][12] (centre, then R row-major), "
                          "size [n][3] as in MJCF. See clearance.hpp.")
        .def(
            "__init__",
            [](SolidTree *self, In<std::int32_t, -1> kind, In<double, -1, 12> pose, In<double, -1, 3> size) {
                const std::size_t n = kind.shape(0);
                if (pose.shape(0) != n || size.shape(0) != n) {
                    throw std::invalid_argument("kind, pose and size must have the same length");
                }
                std::vector<hil::sim::Solid> solids(n);
                for (std::size_t i = 0; i < n; ++i) {
                    solids[i].kind = static_cast<hil::sim::SolidKind>(kind.data()[i]);
                    for (std::size_t k = 0; k < 3; ++k) solids[i].center[k] = pose.data()[12 * i + k];
                    for (std::size_t k = 0; k < 9; ++k) solids[i].R[k] = pose.data()[12 * i + 3 + k];
                    for (std::size_t k = 0; k < 3; ++k) solids[i].size[k] = size.data()[3 * i + k];
                }
                new (self) SolidTree(std::move(solids));
            },
            nb::kw_only(), "kind"_a.noconvert(), "pose"_a.noconvert(), "size"_a.noconvert())
        .def("__len__", &SolidTree::size)
        .def(
            "distance", [](const SolidTree &self, const Vec3 &p_W) { return self.distance(p_W.data()); }, "p_W"_a,
            "Return a lower bound of the distance from a point to the nearest shape [m]; inf without shapes.");

    nb::class_<RigidBody>(m, "RigidBody",
                          "Rigid body with forces on a caller-owned float64 array `truth`: p_WB[3], q_WB[4] (w-x-y-z), "
                          "v_WB_W[3], w_WB_B[3], own states of the forces[n], then mean acceleration in W[3] and mean "
                          "angular acceleration in B[3] over the last tick. SI, ENU/FLU. See body.hpp.")
        .def(nb::init<Out<double, -1>, double, Vec3, Vec3, nb::list, double, Vec3, double, int, int, int, bool>(),
             nb::kw_only(), "truth"_a.noconvert(), "mass_kg"_a, "inertia_kgm2"_a, "inertia_products_kgm2"_a = Vec3{0.0, 0.0, 0.0}, "forces"_a, "gravity_mps2"_a,
             "wind_W_mps"_a, "tick_s"_a, "substeps"_a, "contact_substeps"_a, "hard_contact_substeps"_a = 1,
             "classical"_a = false,
             "forces: in the order of their own states and commands; each belongs to this body alone.")
        .def("fit_battery", &RigidBody::fit_battery, nb::kw_only(), "battery"_a.noconvert(), "cells"_a, "capacity_c"_a,
             "resistance_ohm"_a, "efficiency"_a, "auxiliary_w"_a, "nominal_voltage_v"_a,
             "Fit a pack on the caller's `battery`: charge drawn [C], voltage at the tick's start [V], mean current "
             "over the tick [A], temperature [degC] (read and written with a thermal model only). See battery.hpp.")
        .def("fit_battery_thermal", &RigidBody::fit_battery_thermal, nb::kw_only(), "cells_ohm"_a, "leads_ohm"_a,
             "reference_degc"_a, "activation_k"_a, "heat_capacity_j_per_k"_a, "cooling_w_per_k"_a, "ambient_degc"_a,
             "table_degc"_a, "table_share"_a, "Give the pack a temperature, before fit_battery().")
        .def("battery_capacity_c", &RigidBody::battery_capacity_c, "Return the capacity at the pack's temperature [C].")
        .def("delay_commands", &RigidBody::delay_commands, nb::kw_only(), "dead_time_s"_a, "first"_a, "count"_a,
             "Delay these commands. See command_delay.hpp.")
        .def("forget_commands", &RigidBody::forget_commands, "Forget the commands on their way: all are 0.")
        .def("set_air", &RigidBody::set_air, "site_altitude_m"_a, "warmer_k"_a,
             "Let the density of the air follow the height, in an atmosphere warmer than the standard one; without a call "
             "it is 1.225 kg/m3 everywhere. See air_density.hpp.")
        .def("density_ratio", &RigidBody::density_ratio, "Return the density of the air at the body over 1.225 kg/m3.")
        .def("set_wind", &RigidBody::set_wind, "start_W_mps"_a, "end_W_mps"_a, "Set the wind of the coming tick, linear from start to end.")
        .def("command", &RigidBody::command, "controls"_a,
             "Latch the commands of the coming tick (0..1, signed ones -1..1, saturated). Return -1, or the index of the first value not finite.")
        .def("steady_wrench", &RigidBody::steady_wrench, "controls"_a,
             "Return force [N] and torque [N m] in B, without gravity, that the forces make at the state now once their own "
             "states have come to rest under these commands. Writes those own states to `truth`.")
        .def("fly", &RigidBody::fly, "Advance one tick of free flight; return the distance travelled [m].")
        .def("keeps_clear", &RigidBody::keeps_clear, "travelled_m"_a,
             "Take the way of a tick from what remains to the scene and to actors. False, and nothing is taken, where it "
             "is too long.")
        .def_rw("remaining_m", &RigidBody::remaining_m, "Way that the vehicle may go before a clearance is computed anew.")
        .def_rw("actors_remaining_m", &RigidBody::actors_remaining_m, "The same for actors.")
        .def_rw("approach_m", &RigidBody::approach_m, "Greatest approach of actors in a tick.")
        .def_rw("touching", &RigidBody::touching, "Contact in the last complete tick.")
        .def("cruise", &RigidBody::cruise_with, "controls"_a, "ticks"_a,
             "Fly ticks with the same commands, or those of an IdealController, while each travels less than remains "
             "to the scene and to actors. Return (ticks finished, distance of a tick flown but not finished or -1, "
             "violation as of finish(), index of a command not finite or -1).")
        .def("repair", &RigidBody::repair, "Set all forces to the condition of a new body's: no faults.")
        .def("steps", &RigidBody::steps, "Return the number of integration steps of the last fly().")
        .def("rewind", &RigidBody::rewind, "Restore the state before the last fly().")
        .def("finish", &RigidBody::finish,
             "Write mean accelerations and charge drawn. Return 0, or 1 not finite, 2 speed, 3 body rate, 4 position, "
             "5 no voltage left, 6 battery empty.")
        .def("clearance_before", &RigidBody::clearance_before, "radius_m"_a, "solids"_a,
             "Return a lower bound of the gap to the scene before the last fly() [m].")
        .def("position_before", &RigidBody::position_before, "Return p_WB before the last fly() [m].")
        .def("attach", &RigidBody::attach, "qpos"_a.noconvert(), "qvel"_a.noconvert(), "qfrc_applied"_a.noconvert(),
             "qacc"_a.noconvert(), "Set MuJoCo's arrays, for contact.")
        .def("pose_in_substep", &RigidBody::pose_in_substep, "substep"_a, "share"_a,
             "Write a pose of fly() to qpos; share 1 is the pose after that sub-step.")
        .def("way_in_substep", &RigidBody::way_in_substep, "substep"_a, "Return how far that sub-step of fly() moved the vehicle [m].")
        .def("moved_m", &RigidBody::moved_m, "Return the distance between the state before the last fly() and the state now [m].")
        .def("pose_in_tick", &RigidBody::pose_in_tick, "share"_a,
             "Write a pose between the state before the last fly() and the state now to qpos.")
        .def("contact_load", &RigidBody::contact_load, "substep"_a, "hard"_a,
             "Write the state to qpos and qvel, the sum of the forces to qfrc_applied.")
        .def("serve_mujoco", &RigidBody::serve_mujoco, "qpos"_a.noconvert(), "qvel"_a.noconvert(), "act"_a.noconvert(),
             "qfrc_applied"_a.noconvert(), "Make mujoco_callback() compute the forces of this vehicle.")
        .def_static("mujoco_callback", &RigidBody::mujoco_callback, "Return the address of a MuJoCo control callback.")
        .def("contact_update", &RigidBody::contact_update, "hard"_a, "Advance one contact sub-step with qacc.");

    m.def("near_pairs", &near_pairs, "bodies"_a, "radius_m"_a.noconvert(),
          "Return the pairs (i, j), i < j, whose bounding spheres can have met since the last fly() of each.");
    m.def("cruise_flights", &cruise_flights, "bodies"_a, "controllers"_a, "commands"_a.noconvert(), "flies"_a.noconvert(),
          "ticks"_a, "speed_limit_mps"_a, "out"_a.noconvert(),
          "Cruise with each body whose `flies` is true, and write its result to a row of `out`, as of cruise(). commands: "
          "those of the rotors; with a controller each: rates about x, y, z [rad/s] and thrust over the weight.");
    m.def("observe_flights", &observe_flights, "bodies"_a, "target_W_m"_a.noconvert(), "scale"_a,
          "features"_a.noconvert(), "measures"_a.noconvert(),
          "Write a row for each body. features: each target less p_WB, in B, times scale[0]; v_WB in B times scale[1]; "
          "w_WB_B times scale[2]; R(q_WB) row by row; own states of the forces over their full scale (rotor speeds over their maximum); all clipped to -1..1, as "
          "float32; further columns stay. measures: distance to the first target [m], speed [m/s], body rate [rad/s], "
          "cosine of the tilt.");
    m.def("write_downwash", &write_downwash, "bodies"_a, "wind_W_mps"_a.noconvert(),
          "Write the wind at each body that the wakes of the others make now. See downwash.hpp.");
    m.def(
        "ideal_imu",
        [](nb::tuple q_WB, nb::tuple a_WB_W, nb::tuple w_WB_B, nb::tuple alpha_WB_B, double dt_s, double gravity_mps2) {
            double q[4], a[3], w[3], alpha[3], out[6];
            unpack(q_WB, q, "q_WB");
            unpack(a_WB_W, a, "a_WB_W");
            unpack(w_WB_B, w, "w_WB_B");
            unpack(alpha_WB_B, alpha, "alpha_WB_B");
            hil::sim::ideal_imu(q, a, w, alpha, dt_s, gravity_mps2, out);
            return nb::make_tuple(out[0], out[1], out[2], out[3], out[4], out[5]);
        },
        "q_WB"_a, "a_WB_W"_a, "w_WB_B"_a, "alpha_WB_B"_a, "dt_s"_a, "gravity_mps2"_a,
        "Return mean specific force [m/s2] and mean rate [rad/s] in B over the step just taken: (fx, fy, fz, gx, gy, gz).");
}
