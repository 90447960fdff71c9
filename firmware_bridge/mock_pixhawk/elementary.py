"""Elementary functions that give the same bits on every machine, for the autopilot's guidance.

Python's `math.sin` and its like call the C library, whose variants differ in the last bit between CPUs (see
`hil/signals/native/detmath.hpp`, which these functions follow operation by operation: fdlibm's methods from exactly
rounded operations only). Guidance runs at 50 Hz, so a pure-Python copy is fast enough; `tests/unit` checks it
against the native one bit for bit.

All angles in rad. Arguments must be finite; |x| <= 1e6 for `sin` and `cos`.
"""

from __future__ import annotations

from math import copysign, fabs, floor, frexp, isfinite, ldexp, nan, sqrt

PI = 3.14159265358979311600e00
HALF_PI = 1.57079632679489655800e00
TWO_PI = 2.0 * PI
_PI_LO = 1.2246467991473531772e-16
RAD_FROM_DEG = PI / 180.0
DEG_FROM_RAD = 180.0 / PI

_INV_HALF_PI = 6.36619772367581382433e-01
_P1, _P1T = 1.57079632673412561417e00, 6.07710050650619224932e-11
_P2, _P2T = 6.07710050630396597660e-11, 2.02226624879595063154e-21
_P3, _P3T = 2.02226624871116645580e-21, 8.47842766036889956997e-32

_LN2_HI, _LN2_LO = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_INV_LN2 = 1.44269504088896338700e00

_ATAN_HI = (4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01, HALF_PI)
_ATAN_LO = (2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17,
            6.12323399573676603587e-17)  # fmt: skip
_A = (3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
      -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
      6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
      -3.65315727442169155270e-02, 1.62858201153657823623e-02)  # fmt: skip


def _sin_kernel(x: float, y: float) -> float:
    z = x * x
    v = z * x
    r = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )
    return x - ((z * (0.5 * y - v * r) - y) - v * -1.66666666666666324348e-01)


def _cos_kernel(x: float, y: float) -> float:
    z = x * x
    r = z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))
            )
        )
    )
    hz = 0.5 * z
    w = 1.0 - hz
    return w + (((1.0 - w) - hz) + (z * r - x * y))


def _reduce(x: float) -> tuple[float, float, int]:
    n = float(floor(x * _INV_HALF_PI + 0.5))
    r = x - n * _P1
    w = n * _P1T
    head = r - w
    if fabs(head) < 1.0e-5 * fabs(x) or fabs(head) < 1.0e-3:
        t = r
        w = n * _P2
        r = t - w
        w = n * _P2T - ((t - r) - w)
        head = r - w
        # Only where the second step cancelled too: elsewhere it would drop that step's rounding error.
        if fabs(head) < 1.7763568394002505e-15 * fabs(x):  # 2**-49
            t = r
            w = n * _P3
            r = t - w
            w = n * _P3T - ((t - r) - w)
            head = r - w
    return head, (r - head) - w, int(n) & 3


def sin(x: float) -> float:
    """Sine. Error < 1 ulp; NaN for an argument that is not finite."""
    if not isfinite(x):
        return nan
    if fabs(x) <= 0.25 * PI:
        return _sin_kernel(x, 0.0)
    head, tail, quadrant = _reduce(x)
    if quadrant == 0:
        return _sin_kernel(head, tail)
    if quadrant == 1:
        return _cos_kernel(head, tail)
    if quadrant == 2:
        return -_sin_kernel(head, tail)
    return -_cos_kernel(head, tail)


def cos(x: float) -> float:
    """Cosine. Error < 1 ulp; NaN for an argument that is not finite."""
    if not isfinite(x):
        return nan
    if fabs(x) <= 0.25 * PI:
        return _cos_kernel(x, 0.0)
    head, tail, quadrant = _reduce(x)
    if quadrant == 0:
        return _cos_kernel(head, tail)
    if quadrant == 1:
        return -_sin_kernel(head, tail)
    if quadrant == 2:
        return -_cos_kernel(head, tail)
    return _sin_kernel(head, tail)


def atan(x: float) -> float:
    """Arc tangent. Error < 1 ulp."""
    a = fabs(x)
    if a > 7.378697629483821e19:  # 2**66: pi/2 to the last bit
        return copysign(HALF_PI, x)
    index = -1
    if a >= 2.4375:
        index = 3
        a = -1.0 / a
    elif a >= 1.1875:
        index = 2
        a = (a - 1.5) / (1.0 + 1.5 * a)
    elif a >= 0.6875:
        index = 1
        a = (a - 1.0) / (a + 1.0)
    elif a >= 0.4375:
        index = 0
        a = (2.0 * a - 1.0) / (2.0 + a)
    z = a * a
    w = z * z
    s1 = z * (_A[0] + w * (_A[2] + w * (_A[4] + w * (_A[6] + w * (_A[8] + w * _A[10])))))
    s2 = w * (_A[1] + w * (_A[3] + w * (_A[5] + w * (_A[7] + w * _A[9]))))
    r = a - a * (s1 + s2) if index < 0 else _ATAN_HI[index] - ((a * (s1 + s2) - _ATAN_LO[index]) - a)
    return -r if copysign(1.0, x) < 0.0 else r


def atan2(y: float, x: float) -> float:
    """Angle of the vector (x, y) in (-pi, pi]. Error < 2 ulp. Finite arguments."""
    if y == 0.0:
        return copysign(PI, y) if copysign(1.0, x) < 0.0 else y
    if x == 0.0:
        return copysign(HALF_PI, y)
    a = atan(fabs(y / x))
    return copysign(a if x > 0.0 else PI - (a - _PI_LO), y)


def asin(x: float) -> float:
    """Arc sine for |x| <= 1; arguments beyond (by rounding) are taken as +-1."""
    if x >= 1.0:
        return HALF_PI
    if x <= -1.0:
        return -HALF_PI
    return atan2(x, sqrt((1.0 - x) * (1.0 + x)))


def exp(x: float) -> float:
    """e^x for |x| < 700. Error < 1 ulp."""
    n = float(floor(x * _INV_LN2 + 0.5))
    hi = x - n * _LN2_HI
    lo = n * _LN2_LO
    r = hi - lo
    t = r * r
    c = r - t * (
        1.66666666666666019037e-01
        + t
        * (
            -2.77777777770155933842e-03
            + t * (6.61375632143793436117e-05 + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08))
        )
    )
    return ldexp(1.0 - ((lo - (r * c) / (2.0 - c)) - hi), int(n))


def log(x: float) -> float:
    """Natural logarithm of a positive normal double. Error < 1 ulp."""
    m, k = frexp(x)
    m, k = m * 2.0, k - 1
    if m > 1.41421356237309514547:
        m *= 0.5
        k += 1
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    t1 = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    t2 = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    r = t2 + t1
    hfsq = 0.5 * f * f
    return k * _LN2_HI - ((hfsq - (s * (hfsq + r) + k * _LN2_LO)) - f)


def wrap_pi(angle_rad: float) -> float:
    """The same direction in [-pi, pi]. `angle_rad` within a few turns of zero."""
    while angle_rad > PI:
        angle_rad -= TWO_PI
    while angle_rad < -PI:
        angle_rad += TWO_PI
    return angle_rad


def euler_from_quaternion(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw (z-y'-x'' sequence) of the unit quaternion q_NF: body FRD to NED."""
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = asin(2.0 * (w * y - z * x))
    yaw = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw


def yaw_from_quaternion(w: float, x: float, y: float, z: float) -> float:
    """Heading of the unit quaternion q_NF, in (-pi, pi], 0 = north, positive clockwise seen from above."""
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
