"""A triangulation head and the face of the cube it looks at."""

from __future__ import annotations

import math

import numpy as np

from rigctl.core.arrays import FloatArray
from simulators.worlds.bench_settings import BenchSettings
from simulators.worlds.mounting import Mounting
from simulators.worlds.rotations import Components, nominal_table_from_cube, turned_about_z
from simulators.worlds.stages import Stages

_OUTWARD = {"+x": (1.0, 0.0, 0.0), "+y": (0.0, 1.0, 0.0), "+z": (0.0, 0.0, 1.0)}

_STEEPEST_COS = math.cos(math.radians(30.0))
"""Beyond this incidence too little light comes back to the head."""


class LaserHead:
    """Where the beam of one head meets its face of the mounted cube.

    The beam is a line fixed in the lab; it passes through the middle of the face of a perfectly mounted cube
    with the linear stage where the head was aimed. The reading is the way along it, towards the head.
    """

    def __init__(self, settings: BenchSettings, stages: Stages, mounting: Mounting, name: str) -> None:
        head = settings.lasers[name]
        self._stages = stages
        self._half_m = 1e-3 * settings.cube_half_mm
        self._lever_m = 1e-3 * settings.lever_mm
        self._aim_m = 1e-3 * settings.aim_mm
        self._zero_m = mounting.laser_zero_m[name]
        self._yaw = settings.size("yaw", "psi1")
        self._curvature = settings.size("laser-nonlinearity", "q", name)
        # Of the heads only the one across the motion has crosstalk, unless another is given some by name.
        side = head.position == "+y" or f"chi[{name}]" in settings.effects.get("laser-crosstalk", {})
        self._crosstalk = settings.size("laser-crosstalk", "chi", name) if side else 0.0
        outward = np.array(_OUTWARD[head.position])
        tilt = math.radians(head.tilt_deg) + settings.size("laser-cosine", "dt", name)
        leaning = np.array([1.0, 0.0, 0.0] if head.position == "+z" else [0.0, 0.0, 1.0])
        self._beam = math.cos(tilt) * outward + math.sin(tilt) * leaning
        self._aimed_at = np.array([0.0, self._lever_m, 0.0]) + self._half_m * outward
        nominal = nominal_table_from_cube(settings.sensors[mounting.axis].cube_axis, mounting.configuration)
        face_cube = nominal.T @ outward
        self._normal_table = mounting.table_from_cube @ face_cube
        # The cube's other two axes are the edges of the face.
        first_edge = np.roll(np.abs(face_cube), 1)
        self._edges_table = [
            mounting.table_from_cube @ first_edge,
            mounting.table_from_cube @ np.cross(face_cube, first_edge),
        ]

    def reading_m(self, times_s: FloatArray) -> FloatArray:
        """Noiseless readings; NaN where the spot is off the face or the light comes in too steeply."""
        angle = self._stages.angle_rad(times_s)
        x = self._stages.travel(times_s)[0]
        moved = x - self._aim_m
        turned = angle + self._yaw * x
        resting = turned_about_z(self._normal_table, angle)
        normal = turned_about_z(self._normal_table, turned)
        cosine = _dot(normal, self._beam)
        # The cube stands off the rotation axis, along the turntable's y: turning carries it along.
        centre = (-self._lever_m * np.sin(angle), self._lever_m * np.cos(angle))
        # A face seen from its side; `seen` leaves it out below.
        with np.errstate(divide="ignore", invalid="ignore"):
            # The guide's yaw turns the face as it moves; that a face also swings about the cube's centre is left out.
            from_motion = moved * normal[0] / cosine
            at_rest = (
                self._half_m
                + (centre[0] - self._aimed_at[0]) * resting[0]
                + (centre[1] - self._aimed_at[1]) * resting[1]
                - self._aimed_at[2] * resting[2]
            ) / _dot(resting, self._beam)
            along = at_rest + from_motion
        spot = (
            self._aimed_at[0] + along * self._beam[0] - centre[0] - moved,
            self._aimed_at[1] + along * self._beam[1] - centre[1],
            self._aimed_at[2] + along * self._beam[2],
        )
        # The curve bends about the middle of the travel, wherever the turntable has put it.
        bent = self._curvature * from_motion**2 + self._crosstalk * moved
        seen = cosine > _STEEPEST_COS
        for edge in self._edges_table:
            across = turned_about_z(edge, turned)
            offset = spot[0] * across[0] + spot[1] * across[1] + spot[2] * across[2]
            seen = seen & (np.abs(offset) <= self._half_m)
        return np.where(seen, along + self._zero_m + bent, np.nan)


def _dot(varying: Components, constant: FloatArray) -> FloatArray:
    x, y, z = constant
    return np.asarray(x * varying[0] + y * varying[1] + z * varying[2], dtype=np.float64)
