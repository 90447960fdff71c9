// nanobind entry point of firmware_bridge._native: one bind_* function per kernel file.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

void bind_flight_core(nb::module_ &m);
void bind_realtime_sender(nb::module_ &m);

NB_MODULE(_native, m) {
    // A sender may still be in the hands of a thread that nobody waits for when the interpreter ends: that is no leak.
    nb::set_leak_warnings(false);
    m.doc() = "Estimator and control of the mock Pixhawk; the real-time sender for autopilots that do not wait.";
    bind_flight_core(m);
    bind_realtime_sender(m);
}
