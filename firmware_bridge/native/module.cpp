// nanobind entry point of firmware_bridge._native: MAVLink framing, and estimator, control and mixer of the mock Pixhawk.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

void bind_flight_core(nb::module_ &m);
void bind_mavlink_frame(nb::module_ &m);

NB_MODULE(_native, m) {
    m.doc() = "MAVLink framing; estimator and control of the mock Pixhawk.";
    bind_flight_core(m);
    bind_mavlink_frame(m);
}
