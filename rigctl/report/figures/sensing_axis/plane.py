"""The null vectors about their non-sensitivity plane (figures 15 to 17 of Lucente et al. 2022)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.analysis.plane import ARCSEC
from rigctl.core.arrays import FloatArray
from rigctl.experiments.sensing_axis.result.result import AxisResult
from rigctl.files.package import CYCLIC, AxisSettings
from rigctl.report.chart.axes import Axes
from rigctl.report.chart.figure import Figure
from rigctl.report.figures.data import Plate
from rigctl.report.figures.style import INK, SOFT, SeriesStyle, series_style

IN_RANGE = 1.6
"""The requirement is drawn when it is at most this many times farther out than the data."""


@dataclass(frozen=True)
class PlaneRow:
    """One null vector about the fitted plane.

    The in-plane angle runs from the cube's axis `in_plane_from` towards `in_plane_towards`, both projected on the
    plane; `sigma_fit_arcsec` is the out-of-plane uncertainty of this vector alone, without re-seating scatter.
    """

    axis: str
    configuration: str
    mounting: int
    out_of_plane_arcsec: float
    sigma_fit_arcsec: float
    in_plane_deg: float
    in_plane_from: str
    in_plane_towards: str
    sigma_hc_arcsec: float
    requirement_arcsec: float


def plane_plate(name: str, axis: AxisResult, settings: AxisSettings) -> Plate[PlaneRow]:
    """Make the figure of one axis."""
    required = f", required {axis.requirement_arcsec:g} arcsec" if axis.requirement_is_stated else ""
    caption = (
        f"Null vectors of axis {axis.name} about their non-sensitivity plane. (a) Angle out of the fitted plane with "
        f"1 sigma of each vector's own fit; bands: 1 and 2 half-cone standard deviations (eq. 16), 2 sigma_hc = "
        f"{axis.plane.std_hc_2sigma_arcsec:.2f} arcsec{required}; mean "
        f"out-of-plane angle {axis.plane.theta_m_arcsec:+.3f} arcsec (eq. 19). (b) Directions of the vectors in the "
        f"plane, with mean and standard deviation of their angles from the cube's axis."
    )
    return Plate(name, caption, _rows(axis, settings), draw_plane)


def _rows(axis: AxisResult, settings: AxisSettings) -> list[PlaneRow]:
    # In cyclic order, so that j, k and the axis are right-handed.
    _, j, k = CYCLIC[settings.cube_axis]
    angles = _in_plane_rad(axis.vectors, axis.plane.normal, j)
    normal = axis.plane.normal
    return [
        PlaneRow(
            axis.name,
            null.configuration,
            null.mounting,
            float(out) / ARCSEC,
            _sigma_out_of_plane(normal, null.vector_covariance) / ARCSEC,
            math.degrees(within),
            f"{'xyz'[j]}_coc",
            f"{'xyz'[k]}_coc",
            axis.plane.sigma_hc_rad / ARCSEC,
            axis.requirement_arcsec if axis.requirement_is_stated else math.nan,
        )
        for null, out, within in zip(axis.nulls, axis.plane.half_cone_rad, angles, strict=True)
    ]


def _in_plane_rad(vectors: FloatArray, normal: FloatArray, j: int) -> FloatArray:
    """Angles from cube axis j, projected on the plane, turning right-handed about the normal."""
    # The cube's axis less its part along the normal.
    first = np.eye(3)[j] - normal[j] * normal
    first = first / np.linalg.norm(first)
    return np.asarray(np.arctan2(vectors @ np.cross(normal, first), vectors @ first))


def _sigma_out_of_plane(normal: FloatArray, covariance: FloatArray | None) -> float:
    return 0.0 if covariance is None else math.sqrt(float(normal @ covariance @ normal))


def draw_plane(rows: Sequence[PlaneRow]) -> Figure:
    """Two panels: out-of-plane angles by mounting, and the directions in the plane."""
    figure = Figure(2.9)
    scatter, directions = figure.subplots(1, 2, width_ratios=[1.75, 1.0])
    for index, configuration in enumerate(dict.fromkeys(row.configuration for row in rows)):
        vectors = [row for row in rows if row.configuration == configuration]
        look = series_style(index)
        scatter.errorbar(
            [row.mounting for row in vectors],
            [row.out_of_plane_arcsec for row in vectors],
            yerr=[row.sigma_fit_arcsec for row in vectors],
            fmt=look.marker,
            color=look.color,
            capsize=2.0,
            label=configuration,
            zorder=3,
        )
        _draw_directions(directions, [row.in_plane_deg for row in vectors], look, configuration)
    _draw_bands(scatter, rows)
    _frame_directions(directions, rows)
    scatter.set_xlabel("mounting")
    scatter.set_ylabel("angle out of the plane / arcsec")
    scatter.x.integer = True
    scatter.legend(ncols=3)
    scatter.letter = "a"
    directions.letter = "b"
    return figure


def _draw_directions(axes: Axes, angles_deg: Sequence[float], look: SeriesStyle, configuration: str) -> None:
    vectors = np.exp(1j * np.radians(angles_deg))
    for tip in vectors:
        axes.plot([0.0, tip.real], [0.0, tip.imag], linestyle=look.line, color=look.color, linewidth=0.5)
    mean = vectors.mean()
    # About the mean direction, as angles near 180 deg would tear the mean of numbers apart.
    spread = np.degrees(np.angle(vectors / mean)).std(ddof=min(1, len(vectors) - 1))
    # Adding zero turns a rounded -0.00 into 0.00.
    angle = f"{round(float(np.degrees(np.angle(mean))), 2) + 0.0:.2f}° ± {spread:.2f}°".replace("-", "−")
    label = f"{configuration}, n = {len(vectors)}: {angle}"
    axes.plot(vectors.real, vectors.imag, look.marker, color=look.color, label=label)


def _draw_bands(axes: Axes, rows: Sequence[PlaneRow]) -> None:
    sigma, requirement = rows[0].sigma_hc_arcsec, rows[0].requirement_arcsec
    for multiple, alpha in ((2.0, 0.12), (1.0, 0.16)):
        axes.axhspan(-multiple * sigma, multiple * sigma, color=INK, alpha=alpha)
        for sign, text in ((multiple, "+"), (-multiple, "−")):
            label = f"{text}{'' if multiple == 1.0 else '2'}σ"
            axes.text(1.01, sign * sigma, label, share_x=True)
    axes.axhline(0.0, color=INK, linewidth=0.6, zorder=1)
    reach = max(2.0 * sigma, *(abs(row.out_of_plane_arcsec) + row.sigma_fit_arcsec for row in rows))
    required = "" if math.isnan(requirement) else f", required {requirement:g}″"
    axes.set_title(f"axis {rows[0].axis}: half-cone 2σ = {2.0 * sigma:.1f}″{required}")
    if requirement <= IN_RANGE * reach:
        reach = max(reach, requirement)
        axes.axhline(requirement, color=SOFT, linestyle="--", label=f"requirement ±{requirement:g}″")
        axes.axhline(-requirement, color=SOFT, linestyle="--")
    # More room below, where the legend stands.
    axes.set_ylim(-1.45 * reach, 1.2 * reach)


def _frame_directions(axes: Axes, rows: Sequence[PlaneRow]) -> None:
    """The unit circle, seen from the side the sensing axis points to."""
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.plot(np.cos(circle), np.sin(circle), color=SOFT, linewidth=0.5, zorder=0)
    angles = np.radians([row.in_plane_deg for row in rows])
    (left, right), (bottom, top) = _quadrants(np.cos(angles)), _quadrants(np.sin(angles))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.equal = True
    axes.set_xlabel(f"along {rows[0].in_plane_from[0]} of the cube")
    axes.set_ylabel(f"along {rows[0].in_plane_towards[0]} of the cube")
    axes.legend()


def _quadrants(components: FloatArray) -> tuple[float, float]:
    """Limits that show one side of the unit circle, or both where vectors point both ways."""
    low = -1.0 if components.min() < -0.5 else 0.0
    high = 1.0 if components.max() > 0.5 or low == 0.0 else 0.0
    return low - 0.15, high + 0.15
