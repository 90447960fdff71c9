// hil.apps.identify._programs: straight-line programs evaluated for many instants at once.
//
// A program is a list of operations on numbered places, without branches, as CasADi's SX functions are. Each operation
// runs over a block of kLanes instants before the next one, so that its dispatch costs a share of a nanosecond an instant.
// CasADi's own interpreter dispatches per instant.
//
// Determinism: an instant's numbers are the same in every block, lane, thread and call: no operation reads another lane.
// The compiler neither fuses nor reassociates (CMakeLists.txt). exp, log, pow and the like are those of the C library: they
// feed a fit, no state of a run.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;

namespace {

constexpr int kLanes = 32;  // 200 to 300 places of 32 doubles stay in the second-level cache

// In the order of the table in straight_line.py.
enum Op : std::int32_t {
    kConst, kInput, kOutput, kCopy, kNeg, kTwice, kSquare, kInverse, kSqrt, kExp, kLog, kSin, kCos, kTan, kAsin, kAcos,
    kAtan, kSinh, kCosh, kTanh, kFabs, kSign, kNot, kFloor, kCeil, kExpm1, kLog1p, kErf,
    kAdd, kSub, kMul, kDiv, kPow, kFmin, kFmax, kAtan2, kHypot, kCopysign, kLess, kLessEqual, kEqual, kNotEqual, kAnd,
    kOr, kIfElseZero,
    kOps
};

struct Instruction {
    std::int32_t op, a, b, out;
};

template <class T>
using Column = nb::ndarray<const T, nb::numpy, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::numpy, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Results = nb::ndarray<double, nb::numpy, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

struct Argument {
    const double *data;
    std::size_t rows;
    std::size_t stride;  // 0: one value for all instants
};

struct Result {
    double *data;
    std::size_t size;
};



class StraightLine {
  public:
    StraightLine(const Column<std::int32_t> &code, const Column<double> &constants, std::int32_t places)
        : constants_(constants.data(), constants.data() + constants.shape(0)), places_(places) {
        if (code.shape(0) % 4 != 0) throw std::invalid_argument("code needs four numbers an instruction");
        code_.resize(code.shape(0) / 4);
        for (std::size_t k = 0; k < code_.size(); ++k) {
            const std::int32_t *c = code.data() + 4 * k;
            code_[k] = {c[0], c[1], c[2], c[3]};
            check(code_[k]);
        }
    }

    // inputs: [rows, instants] or [rows, 1]; outputs: [instants, size], of which the program writes the columns it names.
    void evaluate(const std::vector<Rows> &inputs, const std::vector<Results> &outputs) const {
        if (outputs.empty()) throw std::invalid_argument("a program needs an output");
        const std::size_t count = outputs[0].shape(0);
        std::vector<Argument> in;
        for (const Rows &x : inputs) {
            if (x.shape(1) != count && x.shape(1) != 1) {
                throw std::invalid_argument("an input has " + std::to_string(x.shape(1)) + " instants, not " +
                                            std::to_string(count));
            }
            in.push_back({x.data(), x.shape(0), x.shape(1) == 1 && count != 1 ? 0 : x.shape(1)});
        }
        std::vector<Result> out;
        for (const Results &y : outputs) {
            if (y.shape(0) != count) throw std::invalid_argument("outputs differ in their number of instants");
            out.push_back({y.data(), y.shape(1)});
        }
        for (const Instruction &c : code_) {
            if (c.op == kInput && (std::size_t(c.a) >= in.size() || std::size_t(c.b) >= in[c.a].rows)) {
                throw std::invalid_argument("the program reads row " + std::to_string(c.b) + " of input " +
                                            std::to_string(c.a) + ", which is not there");
            }
            if (c.op == kOutput && (std::size_t(c.out) >= out.size() || std::size_t(c.b) >= out[c.out].size)) {
                throw std::invalid_argument("the program writes column " + std::to_string(c.b) + " of output " +
                                            std::to_string(c.out) + ", which is not there");
            }
        }
        nb::gil_scoped_release release;
        std::vector<double> work(std::size_t(places_) * kLanes);
        for (std::size_t first = 0; first < count; first += kLanes) {
            const int lanes = count - first < kLanes ? int(count - first) : kLanes;
            block(in, out, work.data(), first, lanes);
        }
    }

  private:
    void check(const Instruction &c) const {
        const bool reads_a = c.op != kConst && c.op != kInput, reads_b = c.op >= kAdd;
        const bool writes = c.op != kOutput;
        if (c.op < 0 || c.op >= kOps || (reads_a && (c.a < 0 || c.a >= places_)) ||
            (reads_b && (c.b < 0 || c.b >= places_)) || (writes && (c.out < 0 || c.out >= places_)) || c.a < 0 || c.b < 0 ||
            c.out < 0 || (c.op == kConst && std::size_t(c.a) >= constants_.size())) {
            throw std::invalid_argument("an instruction is none, or names a place that is not there");
        }
    }

    void block(const std::vector<Argument> &in, const std::vector<Result> &out, double *work, std::size_t first,
               int lanes) const {
        for (const Instruction &c : code_) {
            double *o = work + std::size_t(c.out) * kLanes;
            const double *a = work + std::size_t(c.a) * kLanes;
            const double *b = work + std::size_t(c.b) * kLanes;
            switch (c.op) {
            case kConst: for (int i = 0; i < kLanes; ++i) o[i] = constants_[c.a]; break;
            case kInput: {
                const Argument &x = in[c.a];
                if (x.stride == 0) {
                    for (int i = 0; i < kLanes; ++i) o[i] = x.data[c.b];
                } else {
                    const double *row = x.data + std::size_t(c.b) * x.stride + first;
                    for (int i = 0; i < lanes; ++i) o[i] = row[i];
                    for (int i = lanes; i < kLanes; ++i) o[i] = row[lanes - 1];
                }
                break;
            }
            case kOutput: {
                const Result &y = out[c.out];
                double *column = y.data + first * y.size + std::size_t(c.b);
                for (int i = 0; i < lanes; ++i) column[std::size_t(i) * y.size] = a[i];
                break;
            }
            case kCopy: for (int i = 0; i < kLanes; ++i) o[i] = a[i]; break;
            case kNeg: for (int i = 0; i < kLanes; ++i) o[i] = -a[i]; break;
            case kTwice: for (int i = 0; i < kLanes; ++i) o[i] = 2.0 * a[i]; break;
            case kSquare: for (int i = 0; i < kLanes; ++i) o[i] = a[i] * a[i]; break;
            case kInverse: for (int i = 0; i < kLanes; ++i) o[i] = 1.0 / a[i]; break;
            case kSqrt: for (int i = 0; i < kLanes; ++i) o[i] = std::sqrt(a[i]); break;
            case kExp: for (int i = 0; i < kLanes; ++i) o[i] = std::exp(a[i]); break;
            case kLog: for (int i = 0; i < kLanes; ++i) o[i] = std::log(a[i]); break;
            case kSin: for (int i = 0; i < kLanes; ++i) o[i] = std::sin(a[i]); break;
            case kCos: for (int i = 0; i < kLanes; ++i) o[i] = std::cos(a[i]); break;
            case kTan: for (int i = 0; i < kLanes; ++i) o[i] = std::tan(a[i]); break;
            case kAsin: for (int i = 0; i < kLanes; ++i) o[i] = std::asin(a[i]); break;
            case kAcos: for (int i = 0; i < kLanes; ++i) o[i] = std::acos(a[i]); break;
            case kAtan: for (int i = 0; i < kLanes; ++i) o[i] = std::atan(a[i]); break;
            case kSinh: for (int i = 0; i < kLanes; ++i) o[i] = std::sinh(a[i]); break;
            case kCosh: for (int i = 0; i < kLanes; ++i) o[i] = std::cosh(a[i]); break;
            case kTanh: for (int i = 0; i < kLanes; ++i) o[i] = std::tanh(a[i]); break;
            case kFabs: for (int i = 0; i < kLanes; ++i) o[i] = std::fabs(a[i]); break;
            case kSign:
                for (int i = 0; i < kLanes; ++i) o[i] = a[i] < 0.0 ? -1.0 : a[i] > 0.0 ? 1.0 : a[i];
                break;
            case kNot: for (int i = 0; i < kLanes; ++i) o[i] = a[i] == 0.0 ? 1.0 : 0.0; break;
            case kFloor: for (int i = 0; i < kLanes; ++i) o[i] = std::floor(a[i]); break;
            case kCeil: for (int i = 0; i < kLanes; ++i) o[i] = std::ceil(a[i]); break;
            case kExpm1: for (int i = 0; i < kLanes; ++i) o[i] = std::expm1(a[i]); break;
            case kLog1p: for (int i = 0; i < kLanes; ++i) o[i] = std::log1p(a[i]); break;
            case kErf: for (int i = 0; i < kLanes; ++i) o[i] = std::erf(a[i]); break;
            case kAdd: for (int i = 0; i < kLanes; ++i) o[i] = a[i] + b[i]; break;
            case kSub: for (int i = 0; i < kLanes; ++i) o[i] = a[i] - b[i]; break;
            case kMul: for (int i = 0; i < kLanes; ++i) o[i] = a[i] * b[i]; break;
            case kDiv: for (int i = 0; i < kLanes; ++i) o[i] = a[i] / b[i]; break;
            case kPow: for (int i = 0; i < kLanes; ++i) o[i] = std::pow(a[i], b[i]); break;
            case kFmin: for (int i = 0; i < kLanes; ++i) o[i] = std::fmin(a[i], b[i]); break;
            case kFmax: for (int i = 0; i < kLanes; ++i) o[i] = std::fmax(a[i], b[i]); break;
            case kAtan2: for (int i = 0; i < kLanes; ++i) o[i] = std::atan2(a[i], b[i]); break;
            case kHypot: for (int i = 0; i < kLanes; ++i) o[i] = std::hypot(a[i], b[i]); break;
            case kCopysign: for (int i = 0; i < kLanes; ++i) o[i] = std::copysign(a[i], b[i]); break;
            case kLess: for (int i = 0; i < kLanes; ++i) o[i] = a[i] < b[i] ? 1.0 : 0.0; break;
            case kLessEqual: for (int i = 0; i < kLanes; ++i) o[i] = a[i] <= b[i] ? 1.0 : 0.0; break;
            case kEqual: for (int i = 0; i < kLanes; ++i) o[i] = a[i] == b[i] ? 1.0 : 0.0; break;
            case kNotEqual: for (int i = 0; i < kLanes; ++i) o[i] = a[i] != b[i] ? 1.0 : 0.0; break;
            case kAnd: for (int i = 0; i < kLanes; ++i) o[i] = a[i] != 0.0 && b[i] != 0.0 ? 1.0 : 0.0; break;
            case kOr: for (int i = 0; i < kLanes; ++i) o[i] = a[i] != 0.0 || b[i] != 0.0 ? 1.0 : 0.0; break;
            case kIfElseZero: for (int i = 0; i < kLanes; ++i) o[i] = a[i] != 0.0 ? b[i] : 0.0; break;
            default: break;
            }
        }
    }

    std::vector<Instruction> code_;
    std::vector<double> constants_;
    std::int32_t places_;
};

}  // namespace

NB_MODULE(_programs, m) {
    m.doc() = "Straight-line programs over many instants; evaluate releases the GIL.";
    nb::class_<StraightLine>(m, "StraightLine", "A program: instructions on numbered places.")
        .def(nb::init<const Column<std::int32_t> &, const Column<double> &, std::int32_t>(), "code"_a.noconvert(),
             "constants"_a.noconvert(), "places"_a, "`code`: op, a, b, out of each instruction in turn.")
        .def("evaluate", &StraightLine::evaluate, "inputs"_a.noconvert(), "outputs"_a.noconvert(),
             "Write the outputs [instants, size] of the inputs [rows, instants], or [rows, 1] for all instants.");
}
