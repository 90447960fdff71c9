// Bindings of the kinds of rotors that derive from Rotors, for rotors.cpp, which registers it first.
#pragma once

#include "bind_arrays.hpp"

namespace hil::sim {

void bind_motor_rotors(nb::module_ &m);  // after the models that motors drive

}  // namespace hil::sim
