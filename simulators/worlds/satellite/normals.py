"""Normal random numbers by counter, for many draws at once: a number depends on its draw's key and its place alone.

Philox4x32-10 (Salmon et al., SC11) makes four 32-bit words of a key and a counter, Box-Muller two normals of two
words. Logarithm, sine and cosine are Chebyshev polynomials, right to 1e-8: a compiler can do several lanes at once.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite.layout import LANES

KeyArray = NDArray[np.uint64]

CALLS = 5
PER_STEP = 4 * CALLS
"""Normal numbers of one draw in one step of time."""

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _BITS = np.uint64(0xFFFFFFFF), np.uint64(32)
_EXPONENT_OF_52 = np.uint64(0x4330000000000000)
"""Or-ed with an integer below 2^52 these are the bits of 2^52 + that integer."""
_MANTISSA, _ONE = np.uint64(0x000FFFFFFFFFFFFF), np.uint64(0x3FF0000000000000)
_TWO_52 = 4503599627370496.0
_MANTISSA_BITS = np.uint64(52)
_LN2 = float(np.log(2.0))


def _powers(function: Any, low: float, high: float, degree: int) -> tuple[float, ...]:
    """Coefficients of powers of x of the Chebyshev interpolant on [low, high]."""
    fitted = chebyshev.Chebyshev.interpolate(function, degree, domain=[low, high])
    return tuple(float(c) for c in fitted.convert(kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]).coef)


_LOG = _powers(np.log, 1.0, 2.0, 11)
_SIN = _powers(lambda y: np.sinc(np.sqrt(y)) * np.pi, 0.0, 1.0, 7)
"""sin(pi x) / x in y = x^2."""
_COS = _powers(lambda y: np.cos(np.pi * np.sqrt(y)), 0.0, 1.0, 8)

L = LANES


def key_of(*name: int | str) -> np.uint64:
    """The key of a stream."""
    digest = hashlib.blake2b(repr(name).encode(), digest_size=8).digest()
    return np.uint64(int.from_bytes(digest, "little"))


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def fill(normals: FloatArray, words: KeyArray, doubles: FloatArray, keys: KeyArray, step: int) -> None:
    """The normal numbers of one step, `normals[i * LANES + lane]` with i < PER_STEP, for `keys` of shape (LANES,).

    `words`, of PER_STEP * LANES, is scratch, and `doubles` the same memory as floats.
    """
    now = np.uint64(step)
    for call in range(CALLS):
        which = np.uint64(call)
        at = 4 * call * L
        for lane in range(L):
            c0, c1, c2, c3 = now, which, np.uint64(0), np.uint64(0)
            k0, k1 = keys[lane] & _LOW, keys[lane] >> _BITS
            for _ in range(10):
                p0, p1 = _M0 * c0, _M1 * c2
                c0, c1 = (p1 >> _BITS) ^ c1 ^ k0, p1 & _LOW
                c2, c3 = (p0 >> _BITS) ^ c3 ^ k1, p0 & _LOW
                k0, k1 = (k0 + _W0) & _LOW, (k1 + _W1) & _LOW
            words[at + lane] = c0 | _EXPONENT_OF_52
            words[at + L + lane] = c1 | _EXPONENT_OF_52
            words[at + 2 * L + lane] = c2 | _EXPONENT_OF_52
            words[at + 3 * L + lane] = c3 | _EXPONENT_OF_52
    for i in range(PER_STEP * L):
        normals[i] = doubles[i] - _TWO_52
    # Halves: words of even number are radii, those of odd number angles.
    for pair in range(2 * CALLS):
        at = 2 * pair * L
        for lane in range(L):
            # Never 0, which has no logarithm.
            doubles[at + lane] = (normals[at + lane] + 0.5) * 2.0**-32
        for lane in range(L):
            bits = words[at + lane]
            words[at + lane] = (bits & _MANTISSA) | _ONE
            words[at + L + lane] = (bits >> _MANTISSA_BITS) | _EXPONENT_OF_52
        for lane in range(L):
            m = doubles[at + lane]
            # A double's exponent is stored with 1023 added.
            power = doubles[at + L + lane] - (_TWO_52 + 1023.0)
            log = _LOG[11]
            log = log * m + _LOG[10]
            log = log * m + _LOG[9]
            log = log * m + _LOG[8]
            log = log * m + _LOG[7]
            log = log * m + _LOG[6]
            log = log * m + _LOG[5]
            log = log * m + _LOG[4]
            log = log * m + _LOG[3]
            log = log * m + _LOG[2]
            log = log * m + _LOG[1]
            log = log * m + _LOG[0]
            # The polynomial may be above 0 by its error where the logarithm is 0.
            radius = np.sqrt(max(-2.0 * (log + power * _LN2), 0.0))
            turn = (normals[at + L + lane] + 0.5) * 2.0**-31 - 1.0
            y = turn * turn
            sine = _SIN[7]
            sine = sine * y + _SIN[6]
            sine = sine * y + _SIN[5]
            sine = sine * y + _SIN[4]
            sine = sine * y + _SIN[3]
            sine = sine * y + _SIN[2]
            sine = sine * y + _SIN[1]
            sine = sine * y + _SIN[0]
            cosine = _COS[8]
            cosine = cosine * y + _COS[7]
            cosine = cosine * y + _COS[6]
            cosine = cosine * y + _COS[5]
            cosine = cosine * y + _COS[4]
            cosine = cosine * y + _COS[3]
            cosine = cosine * y + _COS[2]
            cosine = cosine * y + _COS[1]
            cosine = cosine * y + _COS[0]
            normals[at + lane] = radius * cosine
            normals[at + L + lane] = radius * sine * turn
