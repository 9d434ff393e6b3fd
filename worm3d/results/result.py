"""The result of a run."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

from worm3d import measures
from worm3d.measures.posture import Rolled, on_its_side, rolled
from worm3d.measures.waves import Waves, waves_of
from worm3d.measures.way import distance
from worm3d.physics.worm import Worm
from worm3d.recorded.finished import FinishedRun
from worm3d.recorded.series import documented
from worm3d.values.metrics import Summary
from worm3d.values.read_only import brief, listed
from worm3d.values.spelling import spelled
from worm3d.values.variable import AXES, write_csv

if TYPE_CHECKING:
    import xarray

HEADLINES = ("distance_m", "mean_speed_m_s", "heading_change_deg", "cost_of_transport")
"""Metrics that are shown when a result is printed."""


@documented
class Result(FinishedRun):
    """The result of a run with T recorded instants, S finished steps and N segments.

    The result is complete up to the last finished step, also if the run stopped early.
    """

    @property
    def on_its_side(self) -> float | None:
        """Time from which the worm lay on its side [s]. None if it did not do so, or if there is no ground."""
        return on_its_side(self)

    @property
    def distance(self) -> float:
        """Displacement of the centre of mass along the initial heading, in the tangent plane of the surface [m]."""
        return distance(self)

    @property
    def rolled(self) -> Rolled:
        """Roll of the worm at the rows of the result."""
        return rolled(self)

    @property
    def waves(self) -> Waves:
        """The last whole periods of the run, for measures of a gait.

        Raises
        ------
        NoValueError
            The run has no whole periods.
        """
        return waves_of(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the result to a NetCDF4 file.

        An existing file is replaced only after the new file is complete. `worm3d.load`, xarray and other programs can
        read the file. It includes worm and world if their classes belong to worm3d. The file name should end in ".nc".

        Raises
        ------
        OSError
            The file cannot be written.
        """
        from worm3d.results import files  # imports the libraries of files

        files.save(self, path)

    def to_xarray(self) -> xarray.Dataset:
        """Return all variables as an xarray Dataset, with units as attributes.

        Raises
        ------
        ImportError
            xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise ImportError("to_xarray: xarray is not installed; pip install 'worm3d[xarray]'") from error
        variables = {
            each.name: (each.dims, each.values, {"units": each.units, "long_name": each.long_name})
            for each in self.variables()
        }
        coordinates = {"time": variables.pop("time"), "axis": ("axis", list(AXES))}
        attributes = {"status": self.status.name.lower(), "sentence": self.stop.sentence}
        return xarray.Dataset(variables, coordinates, attributes)

    def to_csv(self, path: str | PathLike[str], series: Sequence[str] | None = None) -> None:
        """Write series as comma-separated text, with a row for each instant and a column for each number.

        The first line has the names of the columns, for example "com_x_m".

        Parameters
        ----------
        path : str or Path
        series : sequence of str, optional
            Names of series or of terms of the energy ledger. By default, all are written. The time is always the first
            column.

        Raises
        ------
        ValueError
            A name is unknown, or a series is not recorded at every instant.
        OSError
            The file cannot be written.
        """
        timed = {each.name: each for each in self.variables() if each.dims[:1] == ("time",)}
        names = list(timed) if series is None else list(dict.fromkeys(["time", *series]))
        if unknown := [name for name in names if name not in timed]:
            raise ValueError(f"series: got {', '.join(map(repr, unknown))}, must be among {', '.join(timed)}")
        write_csv([timed[name] for name in names], path)

    def __repr__(self) -> str:
        worm, summary = self.worm, self.summary()
        error = self.error_estimate
        merits = (" ".join(summary.row(name, digits=4)).rstrip() for name in HEADLINES if summary[name] is not None)
        return listed(
            (
                f"Result: {self.stop.sentence}",
                f"  {len(self.time)} rows of {len(self.newton_iterations)} steps of {self.dt:g} s; {worm.segments} "
                f"segments, {worm.length:g} m, {worm.mass:g} kg on {brief(self.world)}",
                f"  {', '.join(merits)}",
                *([] if error is None else [f"  {error.sentence}"]),
                "  arrays: time, joints, com, heading, chamber_length, normal_load, slip, energy, and others",
                "  summary() has all metrics, worm3d.draw(result, 'viewer.html') shows the run",
            )
        )

    def _repr_html_(self) -> str:
        """Return HTML that shows the run and its metrics in a notebook cell."""
        from worm3d.results.pictures import show

        merits = (f"{name} = {value:.6g}" for name, value in self.summary().items() if isinstance(value, float))
        return f"<p>{self.stop.sentence}: {', '.join(merits)}</p>{show(self)._repr_html_()}"

    def summary(self) -> Summary:
        """Return the metrics of the run by name. They are printed as a table.

        A metric is None if it has no value for this run. `reasons` then gives the reason.
        """
        return measures.summary(self)

    def reasons(self) -> dict[str, str]:
        """Return the reasons why metrics of the summary have no value, by the name of the metric."""
        return measures.reasons(self)


@spelled
def load(path: str | PathLike[str], *, worm: Worm | None = None, world: Any = ...) -> Result:
    """Return a result written by `Result.save` or `worm3d run`.

    Parameters
    ----------
    path : str or Path
        The file, or a folder with a `result.nc`.
    worm, world : Worm, World, optional
        Worm and world of the run. They are needed only if their classes are user-defined, because a file cannot store
        such objects. Without these arguments, the result has substitutes that are sufficient for pictures.

    Returns
    -------
    Result
        The result with the same numbers. A run from `Result.state` continues the run bit for bit if the file has the
        whole state. The file of a run with a controller has only the pose and velocities, without the data of the
        controller.

    Raises
    ------
    FileNotFoundError, OSError
        The file does not exist or cannot be read.
    ValueError
        The file is not a result, is damaged, was written by a version that did not store the worm, or lacks a worm or
        world that must be given.
    """
    from worm3d.results import files

    fields, figures = files.read(path, worm, world)
    result = Result(**fields)
    if figures:
        measures.enter_figures(result, figures)
    return result
