#include "speed_nodes.hpp"

#include "detmath.hpp"

namespace hil::sim::radar {

SpeedNodes speed_nodes(int count, double least, double greatest) {
    SpeedNodes nodes{};
    nodes.count = count;
    nodes.middle = 0.5 * (least + greatest);
    nodes.half_span = 0.5 * (greatest - least);
    for (int k = 0; k < count; ++k) nodes.node[k] = count == 1 ? 0.0 : det::cos(det::kPi * (k + 0.5) / count);
    for (int k = 0; k < count; ++k) {
        double product = 1.0;
        for (int j = 0; j < count; ++j) {
            if (j != k) product *= nodes.node[k] - nodes.node[j];
        }
        nodes.scale[k] = 1.0 / product;
    }
    return nodes;
}

}  // namespace hil::sim::radar
