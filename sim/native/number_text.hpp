// Numbers as text: the shortest digits that read back to the same number, laid out as Python's repr has them.
#pragma once

#include <cstddef>

namespace hil::sim {

constexpr std::size_t kLongestNumber = 32;  // characters of one

// Writes x at `out` (room for kLongestNumber) and returns where it ends. nan, inf, -inf for what is no number.
char *number_text(double x, char *out);

}  // namespace hil::sim
