"""The compiled loop: satellite, masses, sensors and control, step by step, many draws in lock step.

What one sensor measures in a step is with the thrust that was asked for in the step before. Frames, signs and symbols
are those of Hardy et al. (arXiv 1707.07630): the applied acceleration of a mass is their eq. 7 for any motion of the
mass, its measurement their eq. 9, drag-free control their eq. 28 and 29.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rigctl.core.arrays import FloatArray
from simulators.worlds.satellite import layout
from simulators.worlds.satellite.believed import believed_gravity
from simulators.worlds.satellite.layout import LANES
from simulators.worlds.satellite.normals import PER_STEP, fill
from simulators.worlds.satellite.sensor_noise import sensor_noise
from simulators.worlds.satellite.thrusters import quantise

KeyArray = NDArray[np.uint64]

L = LANES
_POLES = layout.POLES

_F = layout.FORCING
_STRENGTH, _COS, _SIN, _FALLING = _F["strength"], _F["cosine"], _F["sine"], _F["falling"]
_FORCE, _TORQUE, _WANTED, _TURN = _F["force"], _F["torque"], _F["wanted"], _F["attitude"]
_MOVED, _SPEED, _PUSHED, _REACTION = _F["moved"], _F["speed"], _F["pushed"], _F["reaction"]
_CENTRE, _PARTED, _EXTRA, _LATE = _F["centre"], _F["parted"], _F["applied"], _F["measured"]
_GAIN, _STAR, _GRADIENT, _LOUD = _F["gain"], _F["tracker"], _F["gradient"], _F["loudness"]

_P = layout.by_lane(layout.PARAMETER)
_P1, _P2, _M1, _M2 = _P["position_1"], _P["position_2"], _P["matrix_1"], _P["matrix_2"]
_O1, _O2, _B1, _B2 = _P["offset_1"], _P["offset_2"], _P["bias_1"], _P["bias_2"]
_A1, _A2, _Q1, _Q2 = _P["parasitic_1"], _P["parasitic_2"], _P["quadratic_1"], _P["quadratic_2"]
_E1, _E2, _GYRO, _TRACKER, _DO = _P["axis_1"], _P["axis_2"], _P["gyro"], _P["tracker"], _P["thruster"]

_S = layout.by_lane(layout.STATE)
_ANGLE, _RATE, _I1, _I2, _LAG = _S["attitude"], _S["rate"], _S["integral"], _S["double"], _S["lagged"]
_TH, _WH, _BH, _ASKED, _THRUST = _S["angle"], _S["turning"], _S["drift"], _S["asked"], _S["thrust"]

_C = layout.CONSTANT
_DT, _IN1, _IN2, _K, _WI, _TAU = _C["step"], _C["input_1"], _C["input_2"], _C["gain"], _C["integral"], _C["lag"]
_KP, _KD, _WO = _C["stiffness"], _C["damping"], _C["hybrid"]
_NYZ, _NR, _NG, _NS, _NF, _NT = (
    _C["sensor_yz"],
    _C["readout"],
    _C["angular"],
    _C["tracker"],
    _C["thrust"],
    _C["torque"],
)
_LEAST, _SMALLEST, _LARGEST, _CUBIC, _CROSS = _C["least"], _C["smallest"], _C["largest"], _C["cubic"], _C["cross"]

_RANGE, _SPIN = _C["range"], _C["spin"]

# Constants of other files are compiled in: whoever changes what is imported touches this file too.
_PARAMETERS, _STATES = layout.PARAMETERS * L, layout.STATES * L
_NOISES = PER_STEP * L


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def advance(
    out: FloatArray,
    first: int,
    forcing: FloatArray,
    extra: FloatArray,
    parameter: FloatArray,
    state: FloatArray,
    constant: FloatArray,
    red: FloatArray,
    keys: KeyArray,
) -> None:
    """Steps `first`, `first` + 1, ... one per row of `forcing`; `state` is changed.

    `out` (steps, columns * LANES), or with no row when nobody listens; `extra` (steps, 6 * LANES), or with no row,
    adds to what the sensors measure. `parameter`, `state` and `constant` are flat, placed by `layout`. `red`
    (2, 3, POLES) has of each mass' noise filter poles, residues and, first of its row, the white part's amplitude.
    """
    if parameter.size != _PARAMETERS or state.size != _STATES or red.shape[2] != _POLES:
        raise ValueError("the compiled loop is older than its layout; touch loop.py")
    noise = np.empty(_NOISES)
    words = np.empty(_NOISES, dtype=np.uint64)
    doubles = words.view(np.float64)
    sensor = np.empty(2 * L)
    c = constant
    dt, in1, in2, gain, wi, lag = c[_DT], c[_IN1], c[_IN2], c[_K], c[_WI], c[_DT] / c[_TAU]
    kp, kd = c[_KP], c[_KD]
    h1, h2, h3 = 3.0 * c[_WO], 3.0 * c[_WO] ** 2, c[_WO] ** 3
    n_yz, n_read, n_gyro, n_star, n_thrust, n_torque = c[_NYZ], c[_NR], c[_NG], c[_NS], c[_NF], c[_NT]
    k3_1, k3_2, kxy_1, kxy_2 = c[_CUBIC], c[_CUBIC + 1], c[_CROSS], c[_CROSS + 1]
    most, spin = c[_RANGE], c[_SPIN]
    p, s = parameter, state
    listening, pushed = out.shape[0] > 0, extra.shape[0] > 0
    for row in range(forcing.shape[0]):
        f = forcing[row]
        fill(noise, words, doubles, keys, first + row)
        sensor_noise(sensor, noise, s, red, n_read, f[_LOUD])
        loud_yz = n_yz * f[_LOUD]
        for i in range(L):
            # Satellite: what was asked for in the last step acts now.
            tx, ty, tz = (
                f[_TORQUE] + s[_THRUST + 3 * L + i],
                f[_TORQUE + 1] + s[_THRUST + 4 * L + i],
                f[_TORQUE + 2] + s[_THRUST + 5 * L + i],
            )
            wx, wy, wz = s[_RATE + i] + tx * dt, s[_RATE + L + i] + ty * dt, s[_RATE + 2 * L + i] + tz * dt
            # Angles count from axes that turn by -spin about Y: the rate against them is w - w0 x angle.
            ax, ay, az = s[_ANGLE + i], s[_ANGLE + L + i], s[_ANGLE + 2 * L + i]
            ax, ay, az = ax + (wx + spin * az) * dt, ay + wy * dt, az + (wz - spin * ax) * dt
            s[_RATE + i], s[_RATE + L + i], s[_RATE + 2 * L + i] = wx, wy, wz
            s[_ANGLE + i], s[_ANGLE + L + i], s[_ANGLE + 2 * L + i] = ax, ay, az
            wy -= spin
            # Where the Earth is, turned by the attitude (half tangents: a rotation for any angle).
            qx, qy, qz = 0.5 * ax, 0.5 * ay, 0.5 * az
            r = 2.0 / (1.0 + qx * qx + qy * qy + qz * qz)
            ux, uy, uz = qy * f[_SIN], qz * f[_COS] - qx * f[_SIN], -qy * f[_COS]
            rx = f[_COS] - r * (ux - (qy * uz - qz * uy))
            ry = -r * (uy - (qz * ux - qx * uz))
            rz = f[_SIN] - r * (uz - (qx * uy - qy * ux))
            g = f[_STRENGTH]
            # Gradient less inertia, G = T - In.
            gxx = g * (3.0 * rx * rx - 1.0) + f[_GRADIENT] + wy * wy + wz * wz
            gyy = g * (3.0 * ry * ry - 1.0) + f[_GRADIENT + 1] + wx * wx + wz * wz
            gzz = g * (3.0 * rz * rz - 1.0) + f[_GRADIENT + 2] + wx * wx + wy * wy
            sxy = 3.0 * g * rx * ry + f[_GRADIENT + 3] - wx * wy
            sxz = 3.0 * g * rx * rz + f[_GRADIENT + 4] - wx * wz
            syz = 3.0 * g * ry * rz + f[_GRADIENT + 5] - wy * wz
            gxy, gyx, gxz, gzx, gyz, gzy = sxy + tz, sxy - tz, sxz - ty, sxz + ty, syz + tx, syz - tx
            # What pushes both masses alike.
            react_1, react_2 = f[_REACTION], f[_REACTION + 1]
            e1x, e1y, e1z = p[_E1 + i], p[_E1 + L + i], p[_E1 + 2 * L + i]
            e2x, e2y, e2z = p[_E2 + i], p[_E2 + L + i], p[_E2 + 2 * L + i]
            fx = f[_FORCE] + s[_THRUST + i] - react_1 * e1x - react_2 * e2x
            fy = f[_FORCE + 1] + s[_THRUST + L + i] - react_1 * e1y - react_2 * e2y
            fz = f[_FORCE + 2] + s[_THRUST + 2 * L + i] - react_1 * e1z - react_2 * e2z
            # Mass 1.
            fall = f[_FALLING]
            d, v, a = f[_MOVED], f[_SPEED], f[_PUSHED]
            px = p[_P1 + i] + e1x * d + f[_CENTRE] - f[_PARTED]
            py = p[_P1 + L + i] + e1y * d + f[_CENTRE + 1]
            pz = p[_P1 + 2 * L + i] + e1z * d + f[_CENTRE + 2]
            b1x = (
                fx
                - (gxx * px + gxy * py + gxz * pz)
                + 2.0 * v * (wy * e1z - wz * e1y)
                + a * e1x
                + p[_A1 + i]
                + f[_EXTRA]
                - fall * rx
            )
            b1y = (
                fy
                - (gyx * px + gyy * py + gyz * pz)
                + 2.0 * v * (wz * e1x - wx * e1z)
                + a * e1y
                + p[_A1 + L + i]
                - fall * ry
            )
            b1z = (
                fz
                - (gzx * px + gzy * py + gzz * pz)
                + 2.0 * v * (wx * e1y - wy * e1x)
                + a * e1z
                + p[_A1 + 2 * L + i]
                - fall * rz
            )
            # Mass 2.
            d, v, a = f[_MOVED + 1], f[_SPEED + 1], f[_PUSHED + 1]
            px = p[_P2 + i] + e2x * d + f[_CENTRE] + f[_PARTED]
            py = p[_P2 + L + i] + e2y * d + f[_CENTRE + 1]
            pz = p[_P2 + 2 * L + i] + e2z * d + f[_CENTRE + 2]
            b2x = (
                fx
                - (gxx * px + gxy * py + gxz * pz)
                + 2.0 * v * (wy * e2z - wz * e2y)
                + a * e2x
                + p[_A2 + i]
                + f[_EXTRA + 1]
                + fall * rx
            )
            b2y = (
                fy
                - (gyx * px + gyy * py + gyz * pz)
                + 2.0 * v * (wz * e2x - wx * e2z)
                + a * e2y
                + p[_A2 + L + i]
                + fall * ry
            )
            b2z = (
                fz
                - (gzx * px + gzy * py + gzz * pz)
                + 2.0 * v * (wx * e2y - wy * e2x)
                + a * e2z
                + p[_A2 + 2 * L + i]
                + fall * rz
            )
            # Measurement.
            m1x = (
                f[_GAIN] * (p[_M1 + i] * b1x + p[_M1 + L + i] * b1y + p[_M1 + 2 * L + i] * b1z + p[_O1 + i])
                + p[_B1 + i]
                + (p[_Q1 + i] + k3_1 * b1x) * b1x * b1x
                + kxy_1 * b1x * b1y
                + sensor[i]
                + f[_LATE]
            )
            m1y = (
                p[_M1 + 3 * L + i] * b1x
                + p[_M1 + 4 * L + i] * b1y
                + p[_M1 + 5 * L + i] * b1z
                + p[_O1 + L + i]
                + p[_B1 + L + i]
                + p[_Q1 + L + i] * b1y * b1y
                + loud_yz * noise[4 * L + i]
            )
            m1z = (
                p[_M1 + 6 * L + i] * b1x
                + p[_M1 + 7 * L + i] * b1y
                + p[_M1 + 8 * L + i] * b1z
                + p[_O1 + 2 * L + i]
                + p[_B1 + 2 * L + i]
                + p[_Q1 + 2 * L + i] * b1z * b1z
                + loud_yz * noise[5 * L + i]
            )
            m2x = (
                f[_GAIN + 1] * (p[_M2 + i] * b2x + p[_M2 + L + i] * b2y + p[_M2 + 2 * L + i] * b2z + p[_O2 + i])
                + p[_B2 + i]
                + (p[_Q2 + i] + k3_2 * b2x) * b2x * b2x
                + kxy_2 * b2x * b2y
                + sensor[L + i]
                + f[_LATE + 1]
            )
            m2y = (
                p[_M2 + 3 * L + i] * b2x
                + p[_M2 + 4 * L + i] * b2y
                + p[_M2 + 5 * L + i] * b2z
                + p[_O2 + L + i]
                + p[_B2 + L + i]
                + p[_Q2 + L + i] * b2y * b2y
                + loud_yz * noise[6 * L + i]
            )
            m2z = (
                p[_M2 + 6 * L + i] * b2x
                + p[_M2 + 7 * L + i] * b2y
                + p[_M2 + 8 * L + i] * b2z
                + p[_O2 + 2 * L + i]
                + p[_B2 + 2 * L + i]
                + p[_Q2 + 2 * L + i] * b2z * b2z
                + loud_yz * noise[7 * L + i]
            )
            if pushed:
                m1x += extra[row, i]
                m1y += extra[row, L + i]
                m1z += extra[row, 2 * L + i]
                m2x += extra[row, 3 * L + i]
                m2y += extra[row, 4 * L + i]
                m2z += extra[row, 5 * L + i]
            m1x, m1y, m1z = min(max(m1x, -most), most), min(max(m1y, -most), most), min(max(m1z, -most), most)
            m2x, m2y, m2z = min(max(m2x, -most), most), min(max(m2y, -most), most), min(max(m2z, -most), most)
            # Drag-free control: two integrators, then the thrusters' lag.
            i1x = s[_I1 + i] + (in1 * m1x + in2 * m2x - f[_WANTED]) * dt
            i1y = s[_I1 + L + i] + (in1 * m1y + in2 * m2y - f[_WANTED + 1]) * dt
            i1z = s[_I1 + 2 * L + i] + (in1 * m1z + in2 * m2z - f[_WANTED + 2]) * dt
            i2x, i2y, i2z = s[_I2 + i] + i1x * dt, s[_I2 + L + i] + i1y * dt, s[_I2 + 2 * L + i] + i1z * dt
            s[_I1 + i], s[_I1 + L + i], s[_I1 + 2 * L + i] = i1x, i1y, i1z
            s[_I2 + i], s[_I2 + L + i], s[_I2 + 2 * L + i] = i2x, i2y, i2z
            ulx = s[_LAG + i] + lag * (gain * (i1x + wi * i2x) - s[_LAG + i])
            uly = s[_LAG + L + i] + lag * (gain * (i1y + wi * i2y) - s[_LAG + L + i])
            ulz = s[_LAG + 2 * L + i] + lag * (gain * (i1z + wi * i2z) - s[_LAG + 2 * L + i])
            s[_LAG + i], s[_LAG + L + i], s[_LAG + 2 * L + i] = ulx, uly, ulz
            s[_ASKED + i], s[_ASKED + L + i], s[_ASKED + 2 * L + i] = -ulx, -uly, -ulz
            # Attitude: star tracker and measured angular acceleration, joined by an observer.
            dwx = tx + p[_GYRO + i] + n_gyro * noise[8 * L + i]
            dwy = ty + p[_GYRO + L + i] + n_gyro * noise[9 * L + i]
            dwz = tz + p[_GYRO + 2 * L + i] + n_gyro * noise[10 * L + i]
            thx, thy, thz = s[_TH + i], s[_TH + L + i], s[_TH + 2 * L + i]
            whx, why, whz = s[_WH + i], s[_WH + L + i], s[_WH + 2 * L + i]
            bhx, bhy, bhz = s[_BH + i], s[_BH + L + i], s[_BH + 2 * L + i]
            ox = ax + p[_TRACKER + i] + f[_STAR] - f[_TURN] + n_star * noise[11 * L + i] - thx
            oy = ay + p[_TRACKER + L + i] + f[_STAR + 1] - f[_TURN + 1] + n_star * noise[12 * L + i] - thy
            oz = az + p[_TRACKER + 2 * L + i] + f[_STAR + 2] - f[_TURN + 2] + n_star * noise[13 * L + i] - thz
            # The observer knows how the satellite is to turn.
            thx, thy, thz = (
                thx + (whx + spin * thz + h1 * ox) * dt,
                thy + (why + h1 * oy) * dt,
                thz + (whz - spin * thx + h1 * oz) * dt,
            )
            whx += (dwx - bhx + h2 * ox) * dt
            why += (dwy - bhy + h2 * oy) * dt
            whz += (dwz - bhz + h2 * oz) * dt
            s[_BH + i], s[_BH + L + i], s[_BH + 2 * L + i] = (
                bhx - h3 * ox * dt,
                bhy - h3 * oy * dt,
                bhz - h3 * oz * dt,
            )
            s[_TH + i], s[_TH + L + i], s[_TH + 2 * L + i] = thx, thy, thz
            s[_WH + i], s[_WH + L + i], s[_WH + 2 * L + i] = whx, why, whz
            s[_ASKED + 3 * L + i] = -(kp * thx + kd * whx)
            s[_ASKED + 4 * L + i] = -(kp * thy + kd * why)
            s[_ASKED + 5 * L + i] = -(kp * thz + kd * whz)
            if listening:
                o = out[row]
                o[i], o[L + i], o[2 * L + i] = m1x, m1y, m1z
                o[3 * L + i], o[4 * L + i], o[5 * L + i] = m2x, m2y, m2z
                o[12 * L + i], o[13 * L + i], o[14 * L + i] = dwx, dwy, dwz
                o[15 * L + i], o[16 * L + i], o[17 * L + i] = thx + f[_TURN], thy + f[_TURN + 1], thz + f[_TURN + 2]
                o[18 * L + i], o[19 * L + i], o[20 * L + i] = -ulx, -uly, -ulz
        if listening:
            believed_gravity(out[row], f)
        if c[_LEAST] > 0.0 or c[_SMALLEST] > 0.0 or c[_LARGEST] > 0.0:
            quantise(s, c)
        for axis in range(6):
            at = _DO + 6 * axis * L
            loud = n_thrust if axis < 3 else n_torque
            for i in range(L):
                s[_THRUST + axis * L + i] = (
                    p[at + i] * s[_ASKED + i]
                    + p[at + L + i] * s[_ASKED + L + i]
                    + p[at + 2 * L + i] * s[_ASKED + 2 * L + i]
                    + p[at + 3 * L + i] * s[_ASKED + 3 * L + i]
                    + p[at + 4 * L + i] * s[_ASKED + 4 * L + i]
                    + p[at + 5 * L + i] * s[_ASKED + 5 * L + i]
                    + loud * noise[(14 + axis) * L + i]
                )
