// Registration of the Python class of a force, so that a new force needs no other file:
//
//   static const ForceBinding binding{[](nb::module_ &m) { nb::class_<Buoyancy, Force>(m, "Buoyancy") ... }};
#pragma once

#include "bind_arrays.hpp"
#include "force.hpp"

struct ForceBinding {
    using Bind = void (*)(nb::module_ &);

    explicit ForceBinding(Bind bind_class) : bind(bind_class), next(first) { first = this; }

    Bind bind;
    const ForceBinding *next;
    inline static const ForceBinding *first = nullptr;
};
