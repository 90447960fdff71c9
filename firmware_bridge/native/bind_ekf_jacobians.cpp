// Exposes the generated estimator model so that tests can hold the committed C against the CasADi original.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <string>
#include <vector>

#include "ekf_jacobians.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Function = void (*)(const double *const *, double *const *);
using Rows = std::vector<std::vector<double>>;

struct Entry {
    const char *name;
    Function function;
    std::vector<std::size_t> inputs, outputs;
};

Rows evaluate(const std::string &name, const Rows &inputs) {
    namespace g = hil::flight::generated;
    static const Entry kEntries[] = {
        {"ekf_predict", g::ekf_predict, {16, 6, 1, 1}, {16, 3}},
        {"ekf_transition", g::ekf_transition, {16, 6, 1}, {9, 9, 9, 9, 9, 9, 9, 9}},
        {"ekf_heading", g::ekf_heading, {4, 3}, {3}},
        {"ekf_delayed", g::ekf_delayed, {4, 3, 1}, {9, 9, 9, 9}},
    };
    for (const Entry &e : kEntries) {
        if (name != e.name) continue;
        bool fits = inputs.size() == e.inputs.size();
        for (std::size_t i = 0; fits && i < inputs.size(); ++i) fits = inputs[i].size() == e.inputs[i];
        if (!fits) throw nb::value_error((name + ": inputs do not have the declared sizes").c_str());
        std::vector<const double *> arg;
        for (const auto &input : inputs) arg.push_back(input.data());
        Rows outputs;
        std::vector<double *> res;
        for (const std::size_t n : e.outputs) outputs.emplace_back(n, 0.0);
        for (auto &output : outputs) res.push_back(output.data());
        e.function(arg.data(), res.data());
        return outputs;
    }
    throw nb::value_error(("no generated function " + name).c_str());
}

}  // namespace

void bind_ekf_jacobians(nb::module_ &m) {
    m.def("ekf_generated", &evaluate, "name"_a, "inputs"_a,
          "Evaluates one generated function: lists of floats in and out, sizes as declared in generated/ekf_jacobians.h.");
}
