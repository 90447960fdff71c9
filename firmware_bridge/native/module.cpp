// nanobind entry point of firmware_bridge._native: the mock flight controller's hot loop.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

NB_MODULE(_native, m) {
    m.doc() = "Flight-controller kernels: estimator and cascaded control of the mock Pixhawk.";
}
