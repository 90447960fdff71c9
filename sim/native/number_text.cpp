#include "number_text.hpp"

#include <charconv>
#include <cmath>
#include <cstring>

namespace hil::sim {

namespace {

char *put(char *out, const char *text, std::size_t size) {
    std::memcpy(out, text, size);
    return out + size;
}

char *zeros(char *out, int count) {
    for (int i = 0; i < count; ++i) *out++ = '0';
    return out;
}

}  // namespace

char *number_text(double x, char *out) {
    if (std::isnan(x)) return put(out, "nan", 3);
    if (std::signbit(x)) *out++ = '-';
    if (std::isinf(x)) return put(out, "inf", 3);
    // d.ddde+XX: digits and exponent, from which repr's layout follows.
    char found[kLongestNumber];
    const char *end = std::to_chars(found, found + sizeof found, std::fabs(x), std::chars_format::scientific).ptr;
    char digits[24];
    std::size_t n = 0;
    const char *at = found;
    for (; *at != 'e'; ++at)
        if (*at != '.') digits[n++] = *at;
    int exponent = 0;
    std::from_chars(at + (at[1] == '+' ? 2 : 1), end, exponent);
    const int point = exponent + 1;  // digits before the point
    const int count = static_cast<int>(n);
    if (point > 16 || point < -3) {
        *out++ = digits[0];
        if (n > 1) {
            *out++ = '.';
            out = put(out, digits + 1, n - 1);
        }
        *out++ = 'e';
        *out++ = exponent < 0 ? '-' : '+';
        const int size = exponent < 0 ? -exponent : exponent;
        if (size < 10) *out++ = '0';
        return std::to_chars(out, out + 3, size).ptr;
    }
    if (point <= 0) {
        out = put(out, "0.", 2);
        out = zeros(out, -point);
        return put(out, digits, n);
    }
    if (point >= count) {
        out = put(out, digits, n);
        out = zeros(out, point - count);
        return put(out, ".0", 2);
    }
    out = put(out, digits, static_cast<std::size_t>(point));
    *out++ = '.';
    return put(out, digits + point, n - static_cast<std::size_t>(point));
}

}  // namespace hil::sim
