"""The accelerometer package under test, as the rig file describes it: axes, frames, mountings, heads.

Frames (right-handed): lab L, x along the linear stage, z up; turntable T, v_L = Rz(theta) v_T; cube C,
v_T = R(delta) M v_C with M the nominal matrix of (axis, configuration); U the host's cube, v_U = R_UC v_C.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from rigctl.analysis.plane import ARCSEC
from rigctl.analysis.rotation import FrameRotation, rotation_between
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.core.file_tables import Table
from rigctl.core.units import TILT_MAX_DEG

Direction = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
CubeAxis = Literal["X", "Y", "Z"]

CYCLIC: dict[str, tuple[int, int, int]] = {"X": (0, 1, 2), "Y": (1, 2, 0), "Z": (2, 0, 1)}
"""The cube axes i, j, k of each measured axis: the cyclic order that starts with it."""


def unit_vector(direction: str) -> FloatArray:
    """The unit vector of a name such as '+x', 'x' or '-z'."""
    vector = np.zeros(3)
    vector["xyz".index(direction[-1])] = -1.0 if direction.startswith("-") else 1.0
    return vector


class SensorSettings(Table):
    """What is known beforehand of a sensor in one configuration; `u_` are relative standard uncertainties."""

    gain_v_per_m_s2: Annotated[float, Field(gt=0)]
    frequency_hz: Annotated[float, Field(ge=1e-3, le=1e6)]
    q: Annotated[float, Field(gt=0)]
    u_gain: Annotated[float, Field(gt=0)] = 0.01
    u_frequency: Annotated[float, Field(gt=0)] = 0.02
    u_q: Annotated[float, Field(gt=0)] = 0.3

    @property
    def inv_w0_squared(self) -> float:
        """1 / w0^2 [s2]."""
        # Not w0 itself: in this and in 1 / (w0 Q) the denominator of eq. 1 is linear.
        return (2.0 * math.pi * self.frequency_hz) ** -2

    @property
    def damping(self) -> float:
        """1 / (w0 Q) [s]."""
        return 1.0 / (2.0 * math.pi * self.frequency_hz * self.q)

    @property
    def ring_down_s(self) -> float:
        """Time in which a free oscillation falls by a factor e."""
        # 2 Q / w0.
        return self.q / (math.pi * self.frequency_hz)


class AxisSettings(Table):
    """One sensor of the package."""

    cube_axis: CubeAxis
    nominal: tuple[float, float, float]
    sensor: dict[str, SensorSettings]

    @field_validator("nominal")
    @classmethod
    def _is_a_direction(cls, nominal: tuple[float, float, float]) -> tuple[float, float, float]:
        # Not the components: the squares of very small ones are zero.
        if not np.linalg.norm(nominal) > 0.0:
            raise ValueError("is no direction; write the sensing axis' components along x, y, z of the cube")
        return nominal

    @property
    def nominal_axis(self) -> FloatArray:
        """Unit vector of the nominal sensing axis in C."""
        vector = np.asarray(self.nominal, dtype=np.float64)
        return vector / np.linalg.norm(vector)


class ConfigurationSettings(Table):
    """Where the cube axes i, j, k of the measured axis point on the turntable."""

    i: Direction
    j: Direction
    k: Direction

    @model_validator(mode="after")
    def _is_a_rotation(self) -> ConfigurationSettings:
        # Of signed axes the determinant is +1, -1, or 0 where two are the same line.
        if not np.isclose(np.linalg.det(self._columns()), 1.0):
            raise ValueError(f"i = {self.i}, j = {self.j}, k = {self.k} is no right-handed triad")
        return self

    def _columns(self) -> FloatArray:
        return np.stack([unit_vector(self.i), unit_vector(self.j), unit_vector(self.k)], axis=1)

    def turntable_from_cube(self, cube_axis: str) -> FloatArray:
        """Nominal M: v_T = M v_C, with i, j, k the cyclic order starting at `cube_axis`."""
        matrix = np.zeros((3, 3))
        matrix[:, list(CYCLIC[cube_axis])] = self._columns()
        return matrix


class HeadSettings(Table):
    """A displacement head: where it stands in the lab, and how far its beam is tilted on purpose.

    `u_scale` is the relative standard uncertainty of its reading, from its certificate: scale and beam tilt together.
    """

    position: Direction
    tilt_deg: Annotated[float, Field(gt=-TILT_MAX_DEG, lt=TILT_MAX_DEG)] = 0.0
    u_scale: Annotated[float, Field(ge=0)] = 0.0

    @property
    def tilt_rad(self) -> float:
        """Beam tilt [rad]."""
        return math.radians(self.tilt_deg)

    def certified(self, uncertainty: Mapping[str, float] | None) -> HeadSettings:
        """This head with what a certificate says of its scale and of its tilt; as it is without one."""
        if uncertainty is None:
            return self
        # A tilt error changes the reading as the scale does, by tan(tilt) times the error.
        from_tilt = math.tan(self.tilt_rad) * math.radians(uncertainty.get("tilt_deg", 0.0))
        return self.model_copy(update={"u_scale": math.hypot(uncertainty.get("scale", 0.0), from_tilt)})


PositiveOrZero = Annotated[float, Field(ge=0)]


class MeasuredDirection(Table):
    """A direction known in the cube's frame, such as a face's normal, and as it was measured in the host's."""

    coc: tuple[float, float, float]
    uoaf: tuple[float, float, float]
    u_arcsec: Annotated[float, Field(gt=0)]


Correlation = Annotated[float, Field(ge=-1.0, le=1.0)]

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

# Of a chi-square: directions that fit worse by chance are rarer than mistakes in writing them down.
_IMPOSSIBLE = 1e-6


class Package(Table):
    """The package: sensors, mountings, frames, requirement.

    The host's frame is given by `uoaf_from_coc` with the uncertainty of three turns about the host's axes and their
    correlation (xy, yz, zx), or by `uoaf_directions` that were measured.
    """

    name: str
    requirement_arcsec: Annotated[float, Field(gt=0)] = 100.0
    level_limit_v: Annotated[float, Field(gt=0)] = 1.0
    cube_side_mm: Annotated[float, Field(gt=0)] = 15.0
    lever_mm: float = 72.0
    axes: dict[str, AxisSettings]
    configurations: dict[str, ConfigurationSettings]
    uoaf_from_coc: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]] = (
        IDENTITY
    )
    uoaf_u_arcsec: tuple[PositiveOrZero, PositiveOrZero, PositiveOrZero] = (0.0, 0.0, 0.0)
    uoaf_correlation: tuple[Correlation, Correlation, Correlation] = (0.0, 0.0, 0.0)
    uoaf_directions: tuple[MeasuredDirection, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Package:
        matrix = np.asarray(self.uoaf_from_coc)
        within = np.abs(matrix).max() <= 1.0 + 1e-4
        if not (within and np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) and np.linalg.det(matrix) > 0):
            raise ValueError("uoaf_from_coc is no rotation matrix")
        self._require_one_host_frame()
        for name, axis in self.axes.items():
            if name != axis.cube_axis:
                raise ValueError(
                    f"axes.{name}: recordings name an axis after the cube axis it measures, {axis.cube_axis}"
                )
            missing = sorted(set(self.configurations) - set(axis.sensor))
            if missing:
                raise ValueError(f"axes.{name}.sensor lacks configuration {', '.join(missing)}")
        return self

    def _require_one_host_frame(self) -> None:
        if np.linalg.eigvalsh(self._turns_correlation())[0] < -1e-9:
            raise ValueError(
                "uoaf_correlation: three turns cannot be correlated so; check signs and the order xy, yz, zx"
            )
        if not self.uoaf_directions:
            return
        if self.uoaf_from_coc != IDENTITY or any(self.uoaf_u_arcsec) or any(self.uoaf_correlation):
            raise ValueError(
                "uoaf_directions determine the host's frame; leave out uoaf_from_coc, uoaf_u_arcsec, uoaf_correlation"
            )
        lengths = [np.linalg.norm(v) for each in self.uoaf_directions for v in (each.coc, each.uoaf)]
        if not all(math.isfinite(length) and length > 0.0 for length in lengths):
            raise ValueError("uoaf_directions: a direction is zero or no number")
        try:
            rotation = self.uoaf_rotation()
        except DataError as error:
            raise ValueError(f"uoaf_directions: {error}") from error
        from scipy.special import chdtrc

        if rotation.dof and chdtrc(rotation.dof, rotation.chi2) < _IMPOSSIBLE:
            raise ValueError(
                f"uoaf_directions fit no rotation: chi-square {rotation.chi2:.3g} of {rotation.dof} degrees of "
                "freedom; look for a sign or a face that was mistaken, or raise u_arcsec"
            )

    @property
    def states_requirement(self) -> bool:
        """Whether somebody has stated it: the default is that of the paper's package (Lucente et al. 2022)."""
        return "requirement_arcsec" in self.model_fields_set

    @property
    def states_host_frame(self) -> bool:
        """Whether anything is known of the host's frame; else it is taken for the cube's."""
        return not self.model_fields_set.isdisjoint({"uoaf_from_coc", "uoaf_directions"})

    def uoaf_rotation(self) -> FrameRotation:
        """R_UC with its uncertainty."""
        if not self.uoaf_directions:
            u_rad = np.asarray(self.uoaf_u_arcsec) * ARCSEC
            return FrameRotation(np.asarray(self.uoaf_from_coc), self._turns_correlation() * np.outer(u_rad, u_rad))
        coc, uoaf, u_arcsec = (
            np.array([getattr(each, name) for each in self.uoaf_directions], dtype=np.float64)
            for name in ("coc", "uoaf", "u_arcsec")
        )
        return rotation_between(coc, uoaf, u_arcsec * ARCSEC)

    def _turns_correlation(self) -> FloatArray:
        xy, yz, zx = self.uoaf_correlation
        return np.array([[1.0, xy, zx], [xy, 1.0, yz], [zx, yz, 1.0]])

    def turntable_from_cube(self, axis: str, configuration: str) -> FloatArray:
        """Nominal M of a mounting, shape (3, 3)."""
        return self.configurations[configuration].turntable_from_cube(self.axes[axis].cube_axis)

    def face(self, axis: str, configuration: str, position: str) -> str:
        """The cube face that looks towards a head at `position` in the lab: x y z -x -y -z."""
        # v_T = M v_C, and at theta = 0 turntable and lab agree: the transpose brings the direction back to the cube.
        normal = self.turntable_from_cube(axis, configuration).T @ unit_vector(position)
        component = int(np.argmax(np.abs(normal)))
        return ("-" if normal[component] < 0 else "") + "xyz"[component]

    def spans_plane(self, axis: str, configurations: Iterable[str]) -> bool:
        """Whether motions in these configurations lie along different lines of the cube, as two must for an axis."""
        # The stage moves along x, whose sign the fit of a plane does not mind.
        return len({self.face(axis, name, "+x")[-1] for name in configurations}) > 1

    def spot_margin_mm(self, theta_deg: float, amplitude_mm: float) -> float:
        """How far inside the cube's side face the spot stays; negative when it leaves it.

        The side face is the worst: it turns farthest from the rotation axis, and the motion runs along it.
        """
        # The spot stands still in the lab; turning moves the face's centre sideways by its distance from the axis.
        sideways = abs((self.lever_mm + self.cube_side_mm / 2.0) * math.sin(math.radians(theta_deg)))
        return self.cube_side_mm / 2.0 - sideways - amplitude_mm
